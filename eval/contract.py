"""Whether two environments mean the same by observation, command, force and acceleration.

From the same states and actions each of the four maps is compared by itself, on the same inputs:
what differs at one boundary is not reported again at the next. Nothing is integrated. Two engines
that step one compiled model are compared further: what constraints do, and one step.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final, Literal, TypeAlias, get_args

import numpy as np
import numpy.typing as npt
from gymnasium import spaces

from integ_gym.envs.lanes import DiscretizedVectorEnv
from integ_gym.envs.settings import DELAYS, DISCRETIZATION, Discretization
from integ_gym.envs.testbeds.boundaries import Boundaries, Named
from integ_gym.envs.testbeds.gym_testbed import Testbed
from integ_gym.envs.testbeds.making import find_testbed, make_checked
from integ_gym.support.errors import InputError
from integ_gym.support.terminal import plural
from integ_gym.train.policy_files.sidecar import read_place

from .statistics import Part

Array = npt.NDArray[np.float64]

BoundaryName: TypeAlias = Literal[
    "observation", "command", "force", "acceleration", "constraint", "step"
]

Side: TypeAlias = Literal["first", "second"]

SIDES: Final[tuple[Side, ...]] = get_args(Side)

TOLERANCE: Final = {64: 1e-6, 32: 1e-4}
"""Largest difference of a component over its largest size in all states, by the width of floats.

Rounding and the tolerance of constraint solvers (1e-8) stay below it; a gravity of 9.81 in place of
9.80665 m/s², 3e-4 of it, does not.
"""

FLOOR: Final = 1e-3
"""Of the largest component's size, by which smaller ones are measured: they carry its rounding."""

MOST: Final = 1e9
"""Of a relative difference that is said."""

STATES: Final = 32
"""States that are compared."""

ROLLOUT: Final = 20
"""Random decisions, at most, from a start to a state."""

BEYOND: Final = 1.5
"""How far actions go, over the bounds of the action space: a limit that is missing shows."""


class Differing(Part, frozen=True, kw_only=True):
    """A component that differs, where it differs most.

    Attributes:
        component: its name in the first environment.
        there: its name in the second.
        first: its value in the first, SI units; null where it is not finite.
        second: its value in the second, likewise.
        relative: the difference over the component's largest size, at most 1e9.
    """

    component: str
    there: str
    first: float | None
    second: float | None
    relative: float


class BoundaryCheck(Part, frozen=True, kw_only=True):
    """Two environments at one boundary.

    Attributes:
        boundary: `observation`, `command`, `force` or `acceleration`; of two engines that step one
            model also `constraint`, the generalized force of contacts and limits, and `step`, the
            change of velocity in one step as the second integrates.
        silent: which of the two cannot say, `first` and `second`; empty where it was compared.
        sizes: how many components each has.
        tolerance: relative difference from which on a component differs.
        largest: largest relative difference of any component; null where nothing was compared.
        differing: components that differ, the one that differs most first.
    """

    boundary: BoundaryName
    silent: tuple[Side, ...] = ()
    sizes: tuple[int, int] = (0, 0)
    tolerance: float
    largest: float | None = None
    differing: tuple[Differing, ...] = ()

    @property
    def compared(self) -> bool:
        """Whether both could say."""
        return not self.silent

    @property
    def differs(self) -> bool:
        """Whether it is another map."""
        return bool(self.differing) or len(set(self.sizes)) > 1


class Contract(Part, frozen=True, kw_only=True):
    """Two environments at all boundaries.

    Attributes:
        first: name of the first; of a panel, the cell that policies were trained in.
        second: name of the second; of a panel, the cell that it is held against.
        states: how many states were compared, each with one action.
        starts_alone: whether they are starts of the same seeds, because no state can be set.
        checks: one for each boundary.
    """

    first: str
    second: str
    states: int
    starts_alone: bool
    checks: tuple[BoundaryCheck, ...]

    @property
    def broken(self) -> tuple[BoundaryCheck, ...]:
        """Boundaries at which they differ, the earliest first."""
        return tuple(check for check in self.checks if check.differs)


Cell: TypeAlias = str | Mapping[str, Any] | Discretization
"""A cell as people state it: ``"engine=mujoco,integrator=RK4,dt=0.01"``, the same as a mapping, or
a `Discretization`; what is left out is as the environment has it by itself."""


def compare_contracts(
    first: Cell,
    second: Cell,
    env_id: str | None = None,
    *,
    environment: Mapping[str, Any] | None = None,
    states: int = STATES,
    seed: int = 0,
) -> Contract:
    """Compare two environments, or two cells of one, at four boundaries before any integration.

    State → observation, action → command of the actuators, command → generalized force, and force
    and state → acceleration at once; of two engines that step one compiled model also the force of
    constraints, and one step. The first environment gives the states: starts, and what a few random
    decisions make of them; positions and velocities are matched by their order.

    Args:
        first: with ``env_id`` a cell of it, else an environment: see :func:`find_testbed`.
        second: likewise.
        env_id: the environment whose cells they are.
        environment: constructor arguments of both, without the discretization.
        states: how many.
        seed: of states and actions.

    Raises:
        TypeError, ValueError: for an environment that cannot be made, and for two whose states or
            actions do not correspond.

    >>> import integ_gym
    >>> found = integ_gym.compare_contracts("dt=0.05", "engine=mujoco", "IntegPendulum-v0")
    >>> [check.boundary for check in found.broken]
    []
    """
    if states < 1:
        raise InputError(f"`states` must be 1 or above, got {states}")
    names, boundaries, opened = [], list[Boundaries](), list[DiscretizedVectorEnv]()
    try:
        for side in (first, second):
            name, testbed, place = _resolve_side(side, env_id, environment or {})
            names.append(name)
            environments = make_checked(testbed, place, 1, **without_delays(testbed))
            opened.append(environments)
            boundaries.append(boundaries_of(testbed, environments))
        return compare_boundaries(names, boundaries, states, seed)
    finally:
        for environments in opened:
            environments.close()


def without_delays(testbed: Testbed) -> dict[str, float]:
    """Arguments without the testbed's delays: with them a command is one from before."""
    return {name: 0.0 for name in DELAYS if testbed.arguments.get(name)}


def boundaries_of(testbed: Testbed, environments: DiscretizedVectorEnv) -> Boundaries:
    """What a testbed's environments say, or, of one without ``boundaries``, what any one does.

    Raises:
        ValueError: for a testbed without it whose environments are not stepped one by one.
    """
    say: Callable[[Any], Boundaries] | None = getattr(testbed, "boundaries", None)
    envs: Sequence[Any] = getattr(environments.unwrapped, "envs", ())
    if say is None and not envs:
        raise InputError(
            f"{type(testbed).__name__} does not say what its environments do before they "
            "integrate; give it a method `boundaries`"
        )
    return Boundaries(envs[0]) if say is None else say(environments)


def compare_boundaries(
    names: Sequence[str], boundaries: Sequence[Boundaries], states: int = STATES, seed: int = 0
) -> Contract:
    """Compare two environments that are made.

    Args:
        names: of both.
        boundaries: what they say.
        states: how many.
        seed: of states and actions.

    Raises:
        ValueError: for two whose states or actions do not correspond.
    """
    first, second = boundaries
    starts_alone = not (first.coordinates and second.coordinates)
    _check_correspondence(names, first, second)
    rng = np.random.default_rng(seed)
    places, actions = _draw_states(first, states, seed, rng, starts_alone)
    for one in boundaries:
        one.start(seed)
    width = min(first.width, second.width)
    tolerance = TOLERANCE[32 if width < 64 else 64]
    seeds = range(seed, seed + states)
    found: list[BoundaryCheck] = []

    def check(name: BoundaryName, inputs: Sequence[Any], comparable: bool = True) -> list[Array]:
        """Compare one boundary; what the first environment says, by state.

        A boundary without its input is unknown.
        """
        sides = [_evaluate_boundary(getattr(one, name), places, inputs) for one in boundaries]
        silent = tuple(
            side for side, own in zip(SIDES, sides, strict=True) if own is None or not comparable
        )
        found.append(_compare_values(name, sides, silent, tolerance))
        own = sides[0] if comparable else None
        return [] if own is None else [np.array([*one.values()]) for one in own]

    check("observation", seeds)
    commands = check("command", actions, first.commands == second.commands)
    forces = check("force", commands)
    check("acceleration", forces)
    scheme = second.scheme
    if first.scheme and scheme and first.scheme.engine != scheme.engine:
        check("constraint", forces)
        check("step", [(force, scheme) for force in forces])
    return Contract(
        first=names[0],
        second=names[1],
        states=states,
        starts_alone=starts_alone,
        checks=tuple(found),
    )


def _resolve_side(
    side: Cell, env_id: str | None, environment: Mapping[str, Any]
) -> tuple[str, Testbed, Discretization]:
    """Name, testbed and discretization of one of the two.

    Raises:
        ValueError: for what is no environment, or no cell.
    """
    if env_id is None:
        if not isinstance(side, str) or "=" in side:
            raise InputError(
                f"{side!r} is no environment; give two environments, or --env ID and two cells of "
                "it, such as engine=mujoco,dt=0.01"
            )
        testbed = find_testbed(side, environment)
        return side, testbed, testbed.home
    stated = read_place(side)
    if stated is None:
        raise InputError(f"the cell {side!r} cannot be read; give NAME=VALUE,NAME=VALUE")
    changed = {name: x for name, x in stated.items() if name not in DISCRETIZATION}
    testbed = find_testbed(env_id, {**environment, **changed})
    steps = {name: x for name, x in stated.items() if name in DISCRETIZATION}
    home = testbed.home.arguments()
    if "engine" in steps and "integrator" not in steps and steps["engine"] != home["engine"]:
        steps["integrator"] = testbed.integrators(steps["engine"])[0]
    if "dt" in steps and testbed.control_period is None:
        steps.setdefault("control_period", steps["dt"])
    place = Discretization(**{**home, **steps})
    others = "".join(f", {name}={x}" for name, x in changed.items())
    return f"{place.name}{others}", testbed, place


def _check_correspondence(names: Sequence[str], first: Boundaries, second: Boundaries) -> None:
    """Refuse environments of which the one cannot be put into the other's states.

    Raises:
        ValueError: with what each has.
    """
    spaces_of = [one.action_space for one in (first, second)]
    if type(spaces_of[0]) is not type(spaces_of[1]) or spaces_of[0].shape != spaces_of[1].shape:
        raise InputError(
            f"{names[0]} takes actions of {spaces_of[0]} and {names[1]} of {spaces_of[1]}, so no "
            "action is the same in both; compare environments whose actions have one shape"
        )
    sizes = [(len(one.coordinates), len(one.velocities)) for one in (first, second)]
    if sizes[0] == sizes[1]:
        return
    has = [
        f"{name} has {plural(q, 'position')} and {plural(v, 'velocity', 'velocities')}"
        if q
        else f"{name} cannot be put into a state"
        for name, (q, v) in zip(names, sizes, strict=True)
    ]
    raise InputError(
        f"{has[0]}, and {has[1]}: states are matched by their order, so compare environments with "
        "equally many, or state them in the method `boundaries` of a testbed of your own"
    )


def _draw_states(
    first: Boundaries, count: int, seed: int, rng: np.random.Generator, starts_alone: bool
) -> tuple[list[Array], list[Any]]:
    """States, every second of them after some random decisions, and an action for each."""
    places, actions = [], []
    for k in range(count):
        actions.append(_draw_action(first.action_space, rng, BEYOND))
        if starts_alone:
            places.append(np.zeros(0))
            continue
        first.start(seed + k)
        held = first.state
        for _ in range(int(rng.integers(1, ROLLOUT + 1)) if k % 2 else 0):
            goes_on = first.advance(_draw_action(first.action_space, rng, 1.0))
            held = first.state if np.isfinite(first.state).all() else held
            if not goes_on:
                break
        places.append(held)
    return places, actions


def _draw_action(space: spaces.Space[Any], rng: np.random.Generator, reach: float) -> Any:
    """A random action, uniform within some multiple of its bounds; normal where it has none.

    Raises:
        ValueError: for another space than `Box` and `Discrete`.
    """
    if isinstance(space, spaces.Discrete):
        return int(space.start + rng.integers(space.n))
    if not isinstance(space, spaces.Box):
        raise InputError(
            f"no action of {space} can be drawn beyond its bounds; compare environments whose "
            "actions are a Box or Discrete"
        )
    low, high = space.low.astype(np.float64), space.high.astype(np.float64)
    bounded = np.isfinite(low) & np.isfinite(high)
    low, high = np.where(bounded, low, -1.0), np.where(bounded, high, 1.0)
    centre, radius = 0.5 * (low + high), 0.5 * (high - low)
    drawn = np.where(bounded, rng.uniform(-reach, reach, space.shape), rng.normal(size=space.shape))
    return (centre + radius * drawn).astype(space.dtype)


def _evaluate_boundary(
    boundary: Any, places: Sequence[Array], inputs: Sequence[Any]
) -> list[Named] | None:
    """What an environment says at a boundary in every state; None where it cannot."""
    if len(inputs) < len(places):
        return None
    evaluated = [boundary(place, given) for place, given in zip(places, inputs, strict=True)]
    known = [one for one in evaluated if one is not None]
    return known if len(known) == len(evaluated) else None


def _compare_values(
    name: BoundaryName,
    sides: Sequence[list[Named] | None],
    silent: tuple[Side, ...],
    tolerance: float,
) -> BoundaryCheck:
    """One boundary."""
    one, other = sides
    if silent or one is None or other is None:
        return BoundaryCheck(boundary=name, silent=silent, tolerance=tolerance)
    sizes = len(one[0]), len(other[0])
    if sizes[0] != sizes[1]:
        return BoundaryCheck(boundary=name, sizes=sizes, tolerance=tolerance)
    values, there = (np.array([[*own.values()] for own in side]) for side in (one, other))
    apart = np.where(values == there, 0.0, np.abs(values - there))
    apart = np.where(np.isfinite(apart), apart, np.inf)
    size = np.nan_to_num(np.maximum(np.abs(values), np.abs(there)), posinf=0.0).max(axis=0)
    scale = np.maximum(size, FLOOR * size.max(initial=0.0))
    relative = np.divide(apart, scale, out=np.where(apart > 0.0, np.inf, 0.0), where=scale > 0.0)
    worst, most = relative.argmax(axis=0), np.minimum(relative.max(axis=0), MOST)
    differing = [
        Differing(
            component=[*one[0]][k],
            there=[*other[0]][k],
            first=_finite_or_none(values[worst[k], k]),
            second=_finite_or_none(there[worst[k], k]),
            relative=float(most[k]),
        )
        for k in np.argsort(-most, kind="stable").tolist()
        if most[k] > tolerance
    ]
    return BoundaryCheck(
        boundary=name,
        sizes=sizes,
        tolerance=tolerance,
        largest=float(most.max(initial=0.0)),
        differing=tuple(differing),
    )


def _finite_or_none(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
