"""How much energy a limited control can bring into a plant, in a discretization."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arithmetic.array_ops import ARRAY
from ..episode.settings import Setup
from ..plants.interface import join_state, split_state
from .stepping import Array

CONTROLS = np.linspace(-1.0, 1.0, 5)
"""What is tried at every decision, in shares of the control's limit."""

HALVINGS = 6
"""Of a bisection, which are tried at once."""

METHOD = (
    "At every decision the torque or force among -1, -1/2, 0, 1/2 and 1 times its limit is taken "
    "that leaves the most energy at the next decision."
)


@dataclass(frozen=True)
class Reach:
    """Energy that a search reaches.

    Attributes:
        energy: highest energy at a decision from each start, J, shape (starts,).
        time: first decision at which the energy that was asked for is reached, s, shape
            (starts,); inf where it is not.
        residual: energy that numerical error put in up to then, or up to the end, J, shape
            (starts,).
        states: at every decision, in state order, shape (decisions + 1, starts, n).
        controls: N m or N, shape (decisions, starts).
    """

    energy: Array
    time: Array
    residual: Array
    states: Array
    controls: Array


def goal_energy(setup: Setup) -> float | None:
    """Least energy of rest at the goal, J; None where the task names no such place.

    It is necessary for success, and not sufficient.
    """
    edge = getattr(setup.task, "goal_edge", None)
    if edge is None:
        return None
    return float(setup.system.energy(ARRAY, edge, (0.0,) * len(edge)))


@np.errstate(all="ignore")
def reach(
    setup: Setup, starts: Array, horizon: float, required: float, limits: Array | None = None
) -> Reach:
    """Search greedily for the most energy.

    Energy is pumped fastest by the control that does the most work in each moment; taking at
    every decision what leaves the most energy at the next one does so within the discretization,
    whose own gains and losses count as well. It is a search and no proof; with a grid twice as
    fine, critical torques of the pendulum are the same to 0.002 N m. Delays and noise are left
    out.

    Args:
        setup: plant, discretization and limits, with one value for all lanes.
        starts: true states, shape (starts, n), in state order.
        horizon: time that there is, s.
        required: energy asked for, J.
        limits: of the control, N m or N, shape (starts,); by default the task's.
    """
    timing, engine = setup.timing, setup.engine
    limit = setup.task.control_limit if limits is None else limits
    controls = CONTROLS * np.broadcast_to(np.asarray(limit, dtype=np.float64), len(starts))[:, None]
    states = np.asarray(starts, dtype=np.float64)
    energy = first = energy_at(setup, states)
    highest, time = energy, np.where(energy >= required, 0.0, np.inf)
    given = residual = np.zeros(len(states))
    path, taken = [states], []
    tried = controls.ravel()
    places = np.arange(len(states))
    for decision in range(1, round(horizon / timing.control_period) + 1):
        q, v = split_state(tuple(np.repeat(states, len(CONTROLS), axis=0).T))
        motion = engine.advance(ARRAY, q, v, ((tried, timing.substeps),), None)
        ends = np.stack(join_state(motion.q, motion.v), axis=-1)
        energies = np.nan_to_num(energy_at(setup, ends), nan=-np.inf).reshape(len(states), -1)
        best = energies.argmax(axis=1)
        states = ends.reshape(len(states), len(CONTROLS), -1)[places, best]
        path.append(states)
        taken.append(controls[places, best])
        highest = np.maximum(highest, energies[places, best])
        given = given + (motion.work - sum(motion.losses)).reshape(energies.shape)[places, best]
        residual = np.where(time == np.inf, energies[places, best] - first - given, residual)
        now = decision * timing.control_period
        time = np.where((time == np.inf) & (highest >= required), now, time)
        if np.isfinite(time).all():
            break
    return Reach(highest, time, residual, np.array(path), np.array(taken))


def critical_limit(
    setup: Setup,
    start: Array,
    deadline: float,
    low: float,
    high: float,
    tolerance: float = 1e-3,
) -> float:
    """Smallest limit of the control with which the search reaches the goal's energy in time.

    Found by bisection, several halvings at once; what the task's own limit is does not matter.

    Args:
        setup: plant and discretization.
        start: true state, shape (n,).
        deadline: time that there is, s.
        low: a limit below it, N m or N.
        high: a limit above it.
        tolerance: largest error of the bisection.

    Raises:
        ValueError: if the energy is not reached with ``high``, or the task names no goal.
    """
    required = goal_energy(setup)
    if required is None:
        raise ValueError(f"{type(setup.task).__name__} names no goal at rest: no `goal_edge`")

    def enough(limits: list[float]) -> dict[float, bool]:
        starts = np.tile(start, (len(limits), 1))
        times = reach(setup, starts, deadline, required, np.array(limits)).time
        return dict(zip(limits, np.isfinite(times).tolist(), strict=True))

    if not enough([high])[high]:
        raise ValueError(f"the goal's energy is not reached within {deadline:g} s with {high:g}")
    while high - low > tolerance:
        found = enough(_midpoints(low, high, HALVINGS))
        for _ in range(HALVINGS):
            if high - low > tolerance:
                middle = 0.5 * (low + high)
                low, high = (low, middle) if found[middle] else (middle, high)
    return high


def _midpoints(low: float, high: float, halvings: int) -> list[float]:
    """All that a bisection may ask for in its next halvings."""
    if not halvings:
        return []
    middle = 0.5 * (low + high)
    below, above = _midpoints(low, middle, halvings - 1), _midpoints(middle, high, halvings - 1)
    return [*below, middle, *above]


def energy_at(setup: Setup, states: Array) -> Array:
    """Energy of states (lanes, n), J, shape (lanes,)."""
    q, v = split_state(tuple(states.T))
    with np.errstate(all="ignore"):
        return np.asarray(setup.system.energy(ARRAY, q, v))
