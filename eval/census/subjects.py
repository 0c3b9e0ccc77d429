"""Subjects of the census: environments and engines that can be set to a state and stepped."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from importlib.util import find_spec
from itertools import product
from typing import Any, Literal, NamedTuple, Protocol

import numpy as np

from integ_gym.envs import numerics
from integ_gym.envs.ops.ops import Components
from integ_gym.envs.plants.cart_pole import CartPole
from integ_gym.envs.plants.interface import Plant
from integ_gym.envs.plants.pendulum import Pendulum
from integ_gym.envs.plants.system import PlantSystem
from integ_gym.support.registry import Registry

COAST = 10.0
"""Duration of the free motion whose energy is followed, s."""

State = tuple[Components, Components]
"""(q, v), SI units."""


class Transition(NamedTuple):
    """Where one control period begins, with the control held in it, and where it ends."""

    case: numerics.Case
    end: State


@dataclass(frozen=True)
class Sample:
    """Control periods of one plant."""

    plant: Plant
    transitions: tuple[Transition, ...]

    @property
    def cases(self) -> list[numerics.Case]:
        """Where they begin."""
        return [one.case for one in self.transitions]

    @property
    def step(self) -> numerics.OneStep:
        """The step that was seen, defined on :attr:`cases` alone."""
        seen = {one.case: one.end for one in self.transitions}
        return lambda q, v, control: seen[(q, v, control)]


@dataclass(frozen=True)
class Statement:
    """What the maker says of the discretization.

    Attributes:
        control_period: time between two decisions, s.
        substeps: integration steps in one control period.
        map: the one-step map that is named, by our name for it; None where none is named.
        words: how it is named.
        max_speed: largest speed, rad/s; None: none is stated.
    """

    control_period: float
    substeps: int = 1
    map: str | None = None
    words: str = ""
    max_speed: float | None = None

    @property
    def dt(self) -> float:
        """Integration step, s."""
        return self.control_period / self.substeps


class Access(Protocol):
    """How the motion of a subject is got at."""

    def samples(self, subject: Subject) -> list[Sample]:
        """Control periods under any control, slow enough for no speed limit to act."""

    def drive(self, subject: Subject) -> Sample:
        """Control periods at the highest speeds that can be had."""

    def coast(self, subject: Subject) -> list[State] | None:
        """States at the instants of control of a free motion; None: it cannot be had.

        It lasts :data:`COAST`, and begins 90° from hanging at rest, or as near as can be had.
        """


@dataclass(frozen=True)
class Subject:
    """One line of the census.

    Attributes:
        source: engine or library.
        name: of the integrator or environment there.
        version: of the engine or library.
        published: whether it is an environment that others publish, not an engine of ours.
        plant: what it moves, with its parameters; a body of another shape as the point mass on a
            rod that moves alike.
        stated: what its maker says.
        max_control: largest control, N or N m.
        access: how its motion is got at; None of what was measured and let go.
        width: bits of the floats in which states are seen.
        note: what a reader of the line has to know.
    """

    source: str
    name: str
    version: str
    published: bool
    plant: Plant
    stated: Statement
    max_control: float
    access: Access | None = field(repr=False)
    width: int = 64
    note: str = ""

    @property
    def coasting_steps(self) -> int:
        """Control periods in the free motion."""
        return round(COAST / self.stated.control_period)


COUNT = 40
"""Control periods that are compared with the known maps."""

BELOW = 0.9
"""Share of a stated speed limit below which it does not act in the next control period."""

Policy = Literal["random", "driven", "zero"]
"""Random controls; the largest in the direction of motion; none."""


class Episode(NamedTuple):
    """States at the instants of control, and the controls between them."""

    states: list[State]
    controls: list[float]


@dataclass(frozen=True)
class Observed:
    """Access by watching episodes.

    Attributes:
        watch: episodes under a policy.
        has_zero: whether a control of zero can be had, and episodes last with it.
    """

    watch: Callable[[Policy], list[Episode]]
    has_zero: bool = True

    def samples(self, subject: Subject) -> list[Sample]:
        """Evenly out of episodes under random controls."""
        limit = subject.stated.max_speed
        seen = [
            one
            for one in _transitions(self.watch("random"))
            if limit is None or max(map(abs, one.case[1])) < BELOW * limit
        ]
        return [Sample(subject.plant, tuple(seen[:: max(1, len(seen) // COUNT)][:COUNT]))]

    def drive(self, subject: Subject) -> Sample:
        """The fastest out of episodes that are driven."""
        seen = _transitions(self.watch("driven"))
        seen.sort(key=lambda one: -max(map(abs, one.case[1])))
        return Sample(subject.plant, tuple(seen[:COUNT]))

    def coast(self, subject: Subject) -> list[State] | None:
        """The episode without control that begins nearest to 90° from hanging at rest."""
        if not self.has_zero:
            return None
        steps = subject.coasting_steps
        whole = [e.states for e in self.watch("zero") if len(e.states) > steps]

        def from_the_side(states: list[State]) -> float:
            q, v = states[0]
            return float(abs(math.cos(q[-1])) + max(map(abs, v)))

        return min(whole, key=from_the_side)[: steps + 1]


def nearest_turn(angle: float, near: float) -> float:
    """The angle, known but for full turns, that is nearest to another, rad."""
    return near + math.remainder(angle - near, math.tau)


def _transitions(episodes: list[Episode]) -> list[Transition]:
    return [
        Transition((*episode.states[k], control), episode.states[k + 1])
        for episode in episodes
        for k, control in enumerate(episode.controls)
    ]


SETTABLE_COUNT = 10
"""Random states without control, and as many with."""

FAST = (7.9, 40.0)
"""Speeds at which a speed limit is looked for, rad/s or m/s."""


@dataclass(frozen=True)
class Settable:
    """Access by setting the state before each control period.

    Attributes:
        step: advances the subject by one control period.
        spread: states are drawn within ± this, SI units; inside of any stops.
        damped: the same with damping in the joints, which tells some maps apart.
        swings: whether it can go round from 90°; False where stops prevent it.
    """

    step: numerics.OneStep
    spread: float = 1.5
    damped: tuple[Plant, numerics.OneStep] | None = None
    swings: bool = True

    def samples(self, subject: Subject) -> list[Sample]:
        """From random states, half of them under random controls."""
        kinds = [(subject.plant, self.step), *([self.damped] if self.damped else [])]
        scale = subject.max_control / self.spread
        samples = []
        for plant, step in kinds:
            cases = [
                _round_to_width((q, v, scale * control), subject.width)
                for given in (False, True)
                for q, v, control in numerics.cases_of(plant, given, SETTABLE_COUNT, self.spread)
            ]
            samples.append(_take(plant, step, cases))
        return samples

    def drive(self, subject: Subject) -> Sample:
        """From fast states, under the largest control in the direction of motion."""
        n = len(subject.plant.coordinates)
        still, cases = (0.0,) * (n - 1), []
        for angle, speed, sign in product((0.5, 1.5, 2.5), FAST, (1.0, -1.0)):
            case = ((*still, sign * angle), (*still, sign * speed), sign * subject.max_control)
            cases.append(_round_to_width(case, subject.width))
        return _take(subject.plant, self.step, cases)

    def coast(self, subject: Subject) -> list[State] | None:
        """From 90° at rest."""
        if not self.swings:
            return None
        n = len(subject.plant.coordinates)
        state: State = (*(0.0,) * (n - 1), 0.5 * math.pi), (0.0,) * n
        states = [state]
        for _ in range(subject.coasting_steps):
            state = _end(self.step, (*state, 0.0))
            states.append(state)
        return states


def _take(plant: Plant, step: numerics.OneStep, cases: Iterable[numerics.Case]) -> Sample:
    """The control periods that end in a finite state."""
    taken = (Transition(case, _end(step, case)) for case in cases)
    return Sample(plant, tuple(one for one in taken if np.isfinite(one.end).all()))


def _end(step: numerics.OneStep, case: numerics.Case) -> State:
    """Where a control period ends; NaN where its arithmetic fails."""
    try:
        return step(*case)
    except (ArithmeticError, ValueError):  # of a component that is not finite
        lost = (math.nan,) * len(case[0])
        return lost, lost


def _round_to_width(case: numerics.Case, width: int) -> numerics.Case:
    """The case as floats of that width hold it."""
    if width == 64:
        return case
    q, v, control = (np.asarray(part, dtype=np.float32).tolist() for part in case)
    return tuple(q), tuple(v), control


SETTINGS: tuple[tuple[Any, float, float], ...] = ((Pendulum(), 0.05, 2.0), (CartPole(), 0.02, 10.0))
"""Plant, step in seconds and largest control: those of Gymnasium's environments."""


def engine_subjects(engine: str, integrators: tuple[str, ...]) -> Iterator[Subject]:
    """The pendulum and the cart-pole of Gymnasium in an engine.

    Args:
        engine: a registered name.
        integrators: as the engine calls them.

    Raises:
        ModuleNotFoundError: if the engine is not installed.
    """
    for plant, dt, max_control in SETTINGS:
        damped = replace(
            plant, **dict.fromkeys(numerics.damping_parameters(plant), numerics.DAMPING)
        )
        for integrator in integrators:
            method = f"{engine}/{integrator}"
            yield Subject(
                source=engine,
                name=integrator,
                published=False,
                plant=plant,
                max_control=max_control,
                access=Settable(
                    numerics.one_step(method, plant, dt),
                    damped=(damped, numerics.one_step(method, damped, dt)),
                ),
                **_statement(method, integrator, plant, dt),
            )


def _statement(method: str, integrator: str, plant: Any, dt: float) -> dict[str, Any]:
    """What an engine says of itself; it is let go."""
    engine = numerics.engine_of(method, PlantSystem(plant), dt)
    stated = Statement(dt, map=getattr(engine, "map", integrator), words=integrator)
    return {"version": engine.version, "stated": stated, "width": engine.width}


_PUBLISHED = "integ_gym.eval.census.published"

PUBLISHED = Registry(
    "published library",
    "subjects",
    {
        "dm_control": f"{_PUBLISHED}:DmControl",
        "envpool": f"{_PUBLISHED}:EnvPool",
        "gymnasium": f"{_PUBLISHED}:Gymnasium",
        "gymnasium_phys2d": f"{_PUBLISHED}:GymnasiumPhys2d",
        "gymnax": f"{_PUBLISHED}:Gymnax",
        "isaaclab": f"{_PUBLISHED}:Isaaclab",
        "mujoco_playground": f"{_PUBLISHED}:MujocoPlayground",
    },
)
"""Library to what its environments are read with."""


def installed(name: str) -> bool:
    """Whether the modules that a library needs are found, and the environment of its own.

    Args:
        name: registered, or ``"module:Class"``.
    """
    library = PUBLISHED.load(name)
    apart = getattr(library, "apart", None)
    found = all(find_spec(module) is not None for module in library.modules)
    return found and (apart is None or bool(apart.installed))
