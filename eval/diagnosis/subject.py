"""What is diagnosed: a plant, where it rests, how fast it swings, and the steps to take."""

from __future__ import annotations

import math
import numbers
from collections.abc import Sequence
from dataclasses import dataclass, fields, is_dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from integ_gym.envs import numerics
from integ_gym.envs.environment import environment_class, environment_setup
from integ_gym.envs.integrators.interface import LinearTheory
from integ_gym.envs.ops.ops import ARRAY, Components, join_state
from integ_gym.envs.plants.interface import Plant
from integ_gym.envs.registries import ENVIRONMENTS, INTEGRATORS, PLANTS
from integ_gym.envs.settings import whole_multiple
from integ_gym.support.errors import InputError

Array = npt.NDArray[Any]

RELEASE = 0.5
"""Displacement from rest at the start of a free motion: rad, or m without any angle."""

SMALL = 0.004
"""Step times fastest rate at which every order up to 4 shows to within a few hundredths."""

_MOST_HALVINGS = 14
_STEPS_PER_RADIAN = 4.0


@dataclass(frozen=True)
class Subject:
    """A plant under diagnosis.

    Attributes:
        name: registered name or ``"module:Class"``.
        plant: with its default parameters.
        environments: registered ids of tasks about this plant.
        steps: integration steps from coarse to fine, s.
        control_period: time between two decisions, s: the coarsest step.
        rest: stable rest state, state order, SI units, shape (n,); a state in motion of a plant
            that has none.
        frequency: of its fastest small oscillation, rad/s; without rest its fastest rate, 1/s.
        slowest: of its slowest small oscillation, or its slowest rate.
        rests: whether it comes to rest without control.
    """

    name: str
    plant: Plant
    environments: tuple[str, ...]
    steps: tuple[float, ...]
    rest: Array
    frequency: float
    slowest: float
    rests: bool = True

    @property
    def control_period(self) -> float:
        """Time between two decisions, s."""
        return self.steps[0]

    @property
    def period(self) -> float:
        """Of the fastest small oscillation, s."""
        return 2.0 * math.pi / self.frequency

    @property
    def start(self) -> Array:
        """Displaced from rest by :data:`RELEASE` in every angle, at zero speed; shape (n,).

        Of a plant without rest the state in motion.
        """
        if not self.rests:
            return self.rest
        units = self.plant.coordinate_units
        moved = [i for i, unit in enumerate(units) if unit == "rad"] or [0]
        start = self.rest.copy()
        start[[2 * i for i in moved]] -= RELEASE
        return start

    def ladder(self, rate: float | None = None, small: float = SMALL) -> tuple[float, ...]:
        """The steps and halves of the coarsest, down to where orders show; coarse to fine, s.

        Args:
            rate: of the fastest thing that happens, 1/s; None: the fastest oscillation.
            small: step times rate of the finest step, at most.
        """
        ratio = self.control_period * (self.frequency if rate is None else rate) / small
        most = min(max(2, math.ceil(math.log2(ratio))), _MOST_HALVINGS)
        halves = (self.control_period / 2**k for k in range(most + 1))
        return tuple(sorted({*self.steps, *halves}, reverse=True))

    def choose_sampling_interval(self, dt: float, interval: float) -> float:
        """Time between two recorded instants, s: whole steps, at most an interval if one fits.

        Of all steps that fit into halves of the coarsest it is the same half.

        Args:
            dt: integration step, s.
            interval: s.
        """
        halvings = max(0, math.ceil(math.log2(self.control_period / interval)))
        half = float(self.control_period / 2**halvings)
        return max(1, math.floor(half / dt * (1.0 + 1e-9))) * dt

    def parameters(self, *words: str) -> tuple[str, ...]:
        """Names of the plant's parameters that end in one of the words."""
        return tuple(f.name for f in fields(self.plant) if f.name.split("_")[-1] in words)  # type: ignore[arg-type]

    def resistances(self, *words: str) -> tuple[str, ...]:
        """Parameters called `damping` or `friction`, those of a stop left out."""
        return tuple(n for n in self.parameters(*words) if not n.startswith("stop"))

    @property
    def undamped(self) -> dict[str, Any]:
        """Parameters that take the plant's own damping and friction away, where it has some."""
        checks = {f.name: f.metadata["check"] for f in fields(self.plant)}  # type: ignore[arg-type]
        names = self.resistances("damping", "friction")
        return {n: 0.0 for n in names if getattr(self.plant, n) and checks[n](0.0) is None}

    def varied(self, **parameters: Any) -> Plant:
        """The plant with other parameters."""
        return type(self.plant)(**parameters)

    def round_up_duration(self, seconds: float) -> float:
        """The next whole number of control periods, s."""
        return math.ceil(seconds / self.control_period - 1e-9) * self.control_period


_STILL = 1e-3
"""Rates below this share of the fastest are no oscillation: a cart rolls, a rotor turns."""

_TIMELESS = 1e-6
"""A fastest rate below this, 1/s, is the rounding of none."""

_FINEST = 1e-4
"""hω below which a step is refused."""

_COARSEST = 10.0
"""hω above which a step is refused: then the oscillation passes between two instants unseen."""


class NoRestError(InputError):
    """A plant has no stable equilibrium without control, about which it could be diagnosed."""


def subjects(env_id: str | None, plant: str | None, steps: Sequence[float]) -> list[Subject]:
    """The plants to diagnose: of an environment, one by name, or all.

    Raises:
        ValueError: for an unknown environment or plant.
    """
    if env_id is not None and plant is not None:
        raise InputError(f"--env {env_id} has its own plant; give --env or --plant, not both")
    if env_id is not None:
        return [_subject(environment_class(env_id).task_class().plant, (env_id,), steps)]
    owners = {i: environment_class(i).task_class().plant for i in ENVIRONMENTS}
    return [
        _subject(name, tuple(i for i, owner in owners.items() if owner == name), steps)
        for name in ((plant,) if plant is not None else PLANTS.names())
    ]


def _subject(name: str, environments: tuple[str, ...], steps: Sequence[float]) -> Subject:
    plant = _check_plant(name, PLANTS.load(name))()
    try:
        rest, rests = _rest_or_motion(plant)
        rates = numerics.linear_rates(plant, rest)
    except ValueError:
        raise
    except Exception as error:  # whatever the equations of a user's plant do
        raise InputError(
            f"the plant {name!r} cannot be evaluated: {type(error).__name__}: {error}; write its "
            "equations with the `ops` that it is given, for floats and arrays alike"
        ) from error
    frequency = float(rates[-1])
    if not frequency > _TIMELESS:
        raise InputError(
            f"the plant {name!r} has no restoring force and no rate of its own; a diagnosis needs "
            "a plant whose motion has a time scale"
        )
    ladder = _ladder(steps or [_usual_step(environments, frequency)])
    _check_scale(name, ladder, frequency)
    slowest = float(rates[rates > _STILL * frequency][0])
    return Subject(name, plant, environments, ladder, rest, frequency, slowest, rests)


def _rest_or_motion(plant: Plant) -> tuple[Array, bool]:
    """Where a plant is pulled to and rests, or else a state in motion; and whether it rests."""
    try:
        rest = rest_state(plant)
    except NoRestError:
        return numerics.probe_state(plant), False

    def resting(points: Array) -> Array:
        return accelerations(plant, tuple(points.T), (0.0,) * len(plant.coordinates))

    pulled = bool(numerics.jacobian(resting, rest[0::2]).any())
    return (rest, True) if pulled else (numerics.probe_state(plant), False)


def _check_plant(name: str, plant: type[Any]) -> type[Any]:
    """``plant`` if it has all that a plant must have.

    Raises:
        ValueError: otherwise, with what is missing.
    """
    needed = (*Plant.__annotations__, *(n for n in vars(Plant) if not n.startswith("_")))
    missing = [n for n in dict.fromkeys(needed) if not hasattr(plant, n)]
    if missing or not is_dataclass(plant):
        lacks = f"lacks {', '.join(missing)}" if missing else "is no dataclass"
        raise InputError(
            f"the plant {name!r} {lacks}; docs/how-to/adding.md has a complete example"
        )
    bare = [f.name for f in fields(plant) if "check" not in f.metadata]
    if bare:
        raise InputError(
            f"`{bare[0]}` of the plant {name!r} has no unit and range; declare it with "
            "integ_gym.support.parameters.parameter, as docs/how-to/adding.md shows"
        )
    return plant


def control_unit(plant: Any) -> str:
    """Unit of a plant's or plant class's controls, or their units."""
    return ", ".join(dict.fromkeys(unit for _, unit in plant.controls))


def _ladder(steps: Sequence[float]) -> tuple[float, ...]:
    """Coarse to fine; one step alone is halved twice."""
    wrong = [step for step in steps if not (math.isfinite(step) and step > 0.0)]
    if wrong:
        raise InputError(f"--dt must be a finite number of seconds above 0, got {wrong[0]:g}")
    ladder = sorted(set(steps), reverse=True)
    for step in ladder[1:]:
        whole_multiple("the largest --dt", ladder[0], "--dt", step)
    return tuple(ladder) if len(ladder) > 1 else tuple(ladder[0] / n for n in (1, 2, 4))


def _check_scale(name: str, ladder: tuple[float, ...], frequency: float) -> None:
    """Refuse steps that say nothing about an oscillation of ``frequency`` rad/s."""
    if ladder[-1] * frequency < _FINEST:
        raise InputError(
            f"--dt {ladder[-1]:g} s is finer than {_FINEST / frequency:.2g} s, where the "
            f"oscillation of {name} takes too many steps; give a larger one"
        )
    if ladder[0] * frequency > _COARSEST:
        raise InputError(
            f"--dt {ladder[0]:g} s is coarser than {_COARSEST / frequency:.2g} s, where a step "
            f"passes over whole oscillations of {name}; give a smaller one"
        )


def _usual_step(environments: tuple[str, ...], frequency: float) -> float:
    """That of the plant's own environment, else 1, 2 or 5 times a power of ten."""
    if environments:
        return environment_setup(environments[0], {}).timing.dt
    wanted = 1.0 / (_STEPS_PER_RADIAN * frequency)
    power = 10.0 ** math.floor(math.log10(wanted))
    return max(m for m in (1.0, 2.0, 5.0) if m * power <= wanted * (1.0 + 1e-9)) * power


def theory_of(integrator: str) -> LinearTheory | None:
    """What an integrator's class itself declares; None where it says nothing.

    None, too, of a user's own that cannot be loaded, where only its results are drawn.
    """
    try:
        owner = INTEGRATORS.load(integrator)
    except ValueError:
        return None
    theory: LinearTheory | None = vars(owner).get("theory")
    return theory


def check_integrator(name: str, subject: Subject) -> None:
    """Refuse an integrator whose attributes say nothing, or that cannot take a step.

    Args:
        name: a registered name or ``"module:Class"``.
        subject: the plant to take it on.

    Raises:
        ValueError: for an unknown integrator, and for one of the above.
    """
    said, owner = numerics.declared(name), INTEGRATORS.load(name)
    answers = {"symplectic": said.symplectic, "reversible": said.reversible}
    amounts = {a: getattr(owner, a, None) for a in ("solver_tolerance", "solver_cap")}
    for attribute, value, wanted, valid in (
        ("order", said.order, "a whole number above 0", _is_number(said.order, numbers.Integral)),
        *((a, x, "True or False", isinstance(x, (bool, np.bool_))) for a, x in answers.items()),
        *((a, x, "a number above 0", _is_number(x, numbers.Real)) for a, x in amounts.items()),
    ):
        if value is not None and not valid:
            raise InputError(
                f"`{attribute}` of the integrator {name!r} must be {wanted}, got {value!r}; leave "
                "it out where nothing is promised"
            )
    dt = subject.steps[-1]
    try:
        numerics.advance(name, subject.plant, subject.start, dt)
        numerics.advance_lanes(name, subject.plant, np.tile(subject.start, (2, 1)), dt)
    except Exception as error:  # whatever a user's step does
        what = " ".join(str(error).split())
        raise InputError(
            f"the integrator {name!r} cannot take a step on {subject.name}: "
            f"{type(error).__name__}: {what}; docs/how-to/adding.md says what an integrator must be"
        ) from error


def _is_number(value: Any, kind: type[Any]) -> bool:
    """Whether a value is a number of a kind above 0."""
    return isinstance(value, kind) and not isinstance(value, (bool, np.bool_)) and value > 0


_MOST_STEPS = 500


_FIRST = 0.5
"""Step times fastest slope at the start, and times a slope that leads away at all times."""


_LARGEST = 1e8
"""Step times fastest slope at which a coordinate that nothing pulls on still stays in place."""


_ROUNDING = 1e-12
"""Accelerations below this share of the fastest slope times the position are rounding."""


_STALLED = 8
"""Steps without a smaller acceleration after which there is nothing more to gain."""


def rest_state(plant: Plant) -> Array:
    r"""A stable equilibrium of the plant without control, state order, SI units, shape (n,).

    Follows :math:`\mathrm dq/\mathrm ds = a(q, 0)` by linearly implicit steps that grow as the
    acceleration falls, so that they begin as descent, end as Newton's method, and are of the
    plant's own scale however stiff or slow it is; along a slope that leads away from an equilibrium
    they stay small, so that none is taken for rest on the top of a hill.

    Raises:
        NoRestError: if it does not come to rest.

    Source: Kelley and Keyes (1998), *Convergence analysis of pseudo-transient continuation*, SIAM
    Journal on Numerical Analysis 35.
    """
    n = len(plant.coordinates)

    def resting(points: Array) -> Array:
        return accelerations(plant, tuple(points.T), (0.0,) * n)

    q = best = 0.1 * np.arange(1.0, n + 1.0)
    least, first, step, stalled = np.inf, 0.0, 0.0, 0
    for _ in range(_MOST_STEPS):
        pull = resting(q[None])[0]
        slopes = numerics.jacobian(resting, q)
        if not (np.isfinite(pull).all() and np.isfinite(slopes).all()):
            break
        size, rates = float(np.abs(pull).max()), np.linalg.eigvals(slopes)
        scale, away = float(np.abs(rates).max()) or 1.0, float(rates.real.max())
        first = first or size * _FIRST / scale
        stalled = 0 if size < least else stalled + 1
        if size < least:
            best, least = q, size
        small = least <= _ROUNDING * scale * (1.0 + np.abs(best).max())
        if small and (least == 0.0 or stalled >= _STALLED):
            return np.array(join_state(tuple(best), (0.0,) * n))
        step = min(first / size, _LARGEST / scale)
        if away > 0.0:
            step = min(step, _FIRST / away)
        q = q + np.linalg.solve(np.eye(n) / step - slopes, pull)
    raise NoRestError(
        f"the plant {type(plant).__name__} does not come to rest without control; a diagnosis "
        "needs a plant with a stable equilibrium"
    )


def accelerations(plant: Plant, q: Components, v: Components) -> Array:
    """Without control, of components of shape (lanes,), shape (lanes, n)."""
    columns = plant.acceleration(ARRAY, q, v, (0.0,) * len(q))
    return np.stack([np.broadcast_to(x, np.shape(q[0])) for x in columns], -1)
