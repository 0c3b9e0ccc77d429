"""A limit: where a testbed has no truth, what its cells are held against.

A limit is extrapolated from three cells at a home's control period: the home's engine and its
integrator of highest order, at a half, a quarter and an eighth of the home's step, with a solver
whose tolerances are ten thousand times smaller and whose iterations are ten times as many.

If halving the step at least halves the error, as in a method of order one or above, no more changes
beyond the finest step than in the last halving. That is all that is assumed of success, so its
interval is widened on either side by the share of episodes whose success still changes (bounds
without a model of what is not known: Manski 2003). Of returns the same holds, and where their
differences shrink they are extrapolated (Richardson 1911), with the order that is observed, at most
the integrator's (Roache 1998).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import msgspec
import numpy as np

from integ_gym.envs.engines.stepping import is_engine, map_of
from integ_gym.envs.integrators.newton import LEAST_TOLERANCE
from integ_gym.envs.registries import INTEGRATORS, MAPS
from integ_gym.envs.settings import Discretization
from integ_gym.envs.testbeds.gym_testbed import Testbed

from ..statistics import Estimate, Floats
from .cells import Cell, Home, SpecError, setup_of
from .result import Entry, Limit

PARTS: Final = (2, 4, 8)
"""Parts of a home's step that the limit is extrapolated from."""

TIGHTER: Final = 1e4
"""A solver's tolerances at home over those at the limit."""

MORE_ITERATIONS: Final = 10
"""Factor of a solver's caps of iterations at the limit."""

_TOLERANCES: Final = ("tolerance", "accuracy", "residual")
"""What names of a solver's tolerances hold, in small letters."""


def order_of(place: Discretization) -> int:
    """Order of a discretization's one-step map in the step; 1 where it is not known.

    Integrators of engines that do not tell their maps are known by name, such as dm_control's RK4.
    """
    name = place.integrator
    if is_engine(place.engine):
        name = map_of(place.engine, name)
    elif ":" not in name:
        name = name.lower()
    registry = MAPS if name in MAPS.names() else INTEGRATORS
    known = ":" in name or name in registry.names()
    return int(getattr(registry.load(name), "order", 1)) if known else 1


def steps_of_limit(
    testbed: Testbed, homes: Sequence[Home], around: Discretization
) -> tuple[dict[str, Any], ...]:
    """Constructor arguments of a limit's steps at each control period of some homes.

    The coarsest comes first; `part` is that of the home's step.
    Of the homes on the engine of the first, the finest step is divided.

    Args:
        testbed: what makes the environments.
        homes: of the policies.
        around: taken where there is no home.

    Raises:
        SpecError: for steps that the testbed does not make.
    """
    own = [place for home in homes for place in home.shares] or [around]
    by_period: dict[float, Discretization] = {}
    for place in own:
        finest = by_period.setdefault(place.control_period, place)
        if place.engine == own[0].engine and place.dt < finest.dt:
            by_period[place.control_period] = place
    return tuple(step for home in by_period.values() for step in _find_steps(testbed, home))


def choose_steps(
    testbed: Testbed, homes: Sequence[Home], around: Discretization, wanted: bool | None
) -> tuple[tuple[dict[str, Any], ...], tuple[str, ...]]:
    """Steps of a limit, and why there is none, as a sentence where it was left open.

    Args:
        testbed: what makes the environments.
        homes: of the policies.
        around: taken where there is no home.
        wanted: whether there is a limit; None: where there is no truth and its steps fit.

    Raises:
        SpecError: for a limit that is wanted, and whose steps the testbed does not make.
    """
    has_truth = testbed.truth(around.control_period) is not None
    if wanted is False or (wanted is None and has_truth):
        return (), ()
    try:
        return steps_of_limit(testbed, homes, around), ()
    except SpecError as error:
        if wanted:
            raise
        return (), (f"No limit is extrapolated: {error}.",)


def _find_steps(testbed: Testbed, home: Discretization) -> tuple[dict[str, Any], ...]:
    """The steps of one home.

    Of integrators of one order the home's own is taken, then the testbed's first. One that the
    testbed does not make at these steps is passed over: MuJoCo's RK4 is taken where a model allows
    it.

    Raises:
        SpecError: if the testbed makes no integrator at these steps, with what it says.
    """
    fault = "it has no integrator"
    for integrator in _sort_by_order(testbed, home):
        places = {part: replace(home, integrator=integrator, dt=home.dt / part) for part in PARTS}
        try:
            steps = {part: _tighten_solver(testbed, place) for part, place in places.items()}
            return tuple({"part": part, **arguments} for part, arguments in steps.items())
        except (TypeError, ValueError) as error:
            fault = str(error)
    raise SpecError(f"a limit needs a half, a quarter and an eighth of {home.name}: {fault}")


def _sort_by_order(testbed: Testbed, home: Discretization) -> list[str]:
    """Integrators of a home's engine, that of highest order first."""
    names = dict.fromkeys((home.integrator, *testbed.integrators(home.engine)))
    known = [name for name in names if name in testbed.integrators(home.engine)]
    return sorted(known, key=lambda name: -order_of(replace(home, integrator=name)))


def _tighten_solver(testbed: Testbed, place: Discretization) -> dict[str, Any]:
    """Arguments of a step, with tighter settings of its solver where the testbed tells any."""
    setup = setup_of(testbed, Cell.of(place, "limit"))
    held = setup.engine.describe().get("solver") or getattr(setup.settings, "solver", None) or {}
    solver = dict(_tighter_settings(held))
    if not solver:
        return place.arguments()
    setup_of(testbed, Cell.of(place, "limit", environment={"solver": solver}))
    return {**place.arguments(), "solver": solver}


def _tighter_settings(settings: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """Those of a solver's settings that say how far it goes, by their names."""
    for name, value in settings.items():
        if any(word in name.lower() for word in _TOLERANCES) and value > LEAST_TOLERANCE:
            yield name, max(LEAST_TOLERANCE, value / TIGHTER)
        elif "iterations" in name.lower() and value > 0:
            yield name, MORE_ITERATIONS * value


@dataclass(frozen=True)
class AtLimit:
    """Outcomes of paired episodes at the limit, shapes (seeds, episodes).

    Attributes:
        success: 1 or 0, at the finest step.
        returns: extrapolated; at the finest step where an episode does not converge; NaN where one
            of the two finest steps has none that is finite.
        changed: whether an episode does not converge.
        changed_before: episodes whose success differs in the two coarser steps.
        success_slack: by how much mean success may be another on either side.
        return_slack: the same of the mean return.
    """

    success: Floats
    returns: Floats
    changed: np.ndarray[Any, np.dtype[np.bool_]]
    changed_before: int
    success_slack: float
    return_slack: float


def extrapolate(
    success: Sequence[Floats], returns: Sequence[Floats], order: int, close: float = np.inf
) -> AtLimit:
    """Outcomes at the limit from those at its steps, of which each is half the one before.

    Args:
        success: 1 or 0 at the three steps, each of shape (seeds, episodes).
        returns: at the three steps, likewise.
        order: of the integrator.
        close: a return that changes by more in the last halving does not converge.
    """
    first, last = returns[1] - returns[0], returns[2] - returns[1]
    flipped = success[1] != success[2]
    changed = flipped | ~(np.abs(last) <= close)
    with np.errstate(divide="ignore", invalid="ignore"):
        shrunk = np.minimum(first / last, 2.0**order)
        beyond = np.where(~changed & (shrunk >= 2.0), last / (shrunk - 1.0), 0.0)
    return AtLimit(
        success[2],
        np.where(np.isfinite(last), returns[2] + beyond, np.nan),
        changed,
        int((success[0] != success[1]).sum()),
        float(flipped.mean()),
        float(np.abs(last).mean()),
    )


def widen(value: Estimate | None, slack: float, low: float = -1.0, high: float = 1.0) -> Any:
    """An interval with a slack on either side, within bounds; None as it is."""
    if value is None or value.low is None or value.high is None:
        return value
    return msgspec.structs.replace(
        value, low=max(low, value.low - slack), high=min(high, value.high + slack)
    )


def entry_at_limit(entry: Entry, limit: Limit | None) -> Entry:
    """An entry of the limit's column, in which success, losses and return are at the limit.

    Args:
        entry: of any cell.
        limit: of its row, whose finest step its cell is; None: it is another cell.
    """
    if limit is None:
        return entry
    parts = ("home_drop", "difficulty", "deadline", "overfitting", "transfer_gap")
    return msgspec.structs.replace(
        entry,
        success=limit.success,
        returns=limit.returns,
        recovered=widen(entry.recovered, limit.success_slack, 0.0),
        **{name: widen(getattr(entry, name), limit.success_slack) for name in parts},
    )
