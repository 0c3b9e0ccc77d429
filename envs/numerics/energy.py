"""What an integrator does to energy: of a free motion, and of a driven one with its ledger."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Literal

import numpy as np

from integ_gym.support.errors import InputError

from ..actuators import ServoPlant
from ..engines.stepping import NativeEngine
from ..ops.ops import ARRAY, SCALAR, join_state, split_state
from ..plants.interface import Plant, controls_of
from ..plants.system import Motion, PlantSystem
from ..settings import Setup
from .stepping import Array, State

Kind = Literal["bounded", "linear", "exponential"]

WINDOWS = 10
"""Parts of the motion whose mean energies are compared."""

BOUNDED = 0.3
"""A drift below this share of the energy's ripple is none."""

ROUNDING = 1e-10
"""Changes below this share of the energy measure the arithmetic."""

DISTINCT = 0.1
"""|log energy ratio| below which linear and exponential growth are the same."""


@dataclass(frozen=True)
class EnergyGrowth:
    """How the energy of a free motion drifts.

    Attributes:
        kind: `bounded` where the drift of the mean energy stays below the energy's own ripple;
            `exponential` where log E follows time better than E does; `linear` otherwise, also
            where the two cannot yet be distinguished (total change below 10 %).
        drift: change of the mean energy from the first to the last tenth of the motion, relative
            to the first; negative where energy is drained. `inf` where the motion diverged.
        largest: max |E − E₀| / E₀.
    """

    kind: Kind
    drift: float
    largest: float


def energies(
    integrator: str, plant: Plant, state: State, dt: float, steps: int, control: float = 0.0
) -> Array:
    """Energy after each step, J, shape (steps + 1,); NaN from where the arithmetic fails.

    Args:
        integrator: a registered name or ``"module:Class"``.
        plant: with numbers as parameters.
        state: start, shape (n,), in state order.
        dt: step, s.
        steps: how many.
        control: held throughout, in the plant's unit.
    """
    system = PlantSystem(plant)
    trace = np.full(steps + 1, np.nan)
    try:
        for k, motion in enumerate(_motions(system, integrator, state, [control] * steps, dt, 1)):
            trace[k] = system.energy(SCALAR, motion.q, motion.v)
    except ArithmeticError:
        pass
    return trace


def energy_growth(energy: Array) -> EnergyGrowth:
    """Classify the energies of a free motion.

    Args:
        energy: J, equally spaced in time over some periods of the motion, shape (steps + 1,), as
            :func:`energies` gives them; the first one above zero.
    """
    largest = float(np.abs(energy / energy[0] - 1.0).max())
    if not np.isfinite(largest):
        return EnergyGrowth("exponential", np.inf, np.inf)
    windows = np.array_split(energy, WINDOWS)
    means = np.array([w.mean() for w in windows])
    ripple = float(np.median([np.ptp(w) for w in windows]))
    drift = float(means[-1] / means[0] - 1.0)
    if abs(means[-1] - means[0]) <= max(BOUNDED * ripple, ROUNDING * energy[0]):
        return EnergyGrowth("bounded", drift, largest)
    return EnergyGrowth("exponential" if _exponential(means) else "linear", drift, largest)


@dataclass(frozen=True)
class Ledger:
    """The energy ledger of a driven motion.

    Attributes:
        state: at the end, in state order, shape (n,).
        energy_change_j: E(end) − E(start), J.
        work_j: work of the control, J.
        losses_j: energy lost to damping and, where the plant has them, further loss components, J.
        clip_loss_j: energy that the speed limit took out, J.
        residuals_j: ΔE − work + losses + clip loss of each control period, J.
    """

    state: Array
    energy_change_j: float
    work_j: float
    losses_j: float
    clip_loss_j: float
    residuals_j: Array

    @property
    def total_residual_j(self) -> float:
        """Σ |residual|, J."""
        return float(np.abs(self.residuals_j).sum())


def ledger(
    integrator: str,
    plant: Plant,
    state: State,
    controls: Sequence[float],
    control_period: float,
    substeps: int,
    max_speed: float | None = None,
) -> Ledger:
    """Drive a plant by a sequence of held controls and keep its ledger.

    Args:
        integrator: a registered name or ``"module:Class"``.
        plant: with numbers as parameters.
        state: start, shape (n,), in state order.
        controls: one per control period, in the plant's units: a number for every control of the
            plant, or a tuple with one of each.
        control_period: s.
        substeps: integration steps per control period.
        max_speed: limit on every velocity component, or None.
    """
    system = PlantSystem(plant, max_speed)
    dt = control_period / substeps
    motions = list(_motions(system, integrator, state, controls, dt, substeps))
    energy = [system.energy(SCALAR, motion.q, motion.v) for motion in motions]
    booked = [(motion.work, sum(motion.losses), motion.clip_loss) for motion in motions[1:]]
    work, losses, clipped = np.reshape(booked, (-1, 3)).T
    return Ledger(
        state=np.array(join_state(motions[-1].q, motions[-1].v)),
        energy_change_j=energy[-1] - energy[0],
        work_j=float(np.sum(work)),
        losses_j=float(np.sum(losses)),
        clip_loss_j=float(np.sum(clipped)),
        residuals_j=np.diff(energy) - work + losses + clipped,
    )


def _motions(
    system: PlantSystem,
    integrator: str,
    state: State,
    controls: Sequence[float],
    dt: float,
    substeps: int,
) -> Iterator[Motion]:
    """The motion under each of several held controls, after one of no time at all."""
    engine = NativeEngine(system, integrator, dt)
    q, v = split_state(tuple(float(x) for x in state))
    yield Motion(q, v, q, v, 0.0, system.no_losses, 0.0, 0, 0.0, True, True)
    for control in controls:
        motion = engine.advance(
            SCALAR, q, v, ((controls_of(system.plant, control), substeps),), None
        )
        q, v = motion.q, motion.v
        yield motion


def _exponential(means: Array) -> bool:
    if means.min() <= 0.0 or abs(np.log(means[-1] / means[0])) < DISTINCT:
        return False
    time = np.arange(float(len(means)))
    return _misfit(time, np.log(means)) < _misfit(time, means)


def _misfit(time: Array, values: Array) -> float:
    """Residual of a straight line, as a share of the values' own spread."""
    line = np.polyval(np.polyfit(time, values, 1), time)
    return float(np.linalg.norm(values - line) / np.linalg.norm(values - values.mean()))


CONTROLS = np.linspace(-1.0, 1.0, 5)
"""What is tried of each control at every decision, in shares of its limit."""

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
        controls: in their units, shape (decisions, starts, controls).
    """

    energy: Array
    time: Array
    residual: Array
    states: Array
    controls: Array


def goal_energy(setup: Setup) -> float | None:
    """Least energy of rest at the goal, J; None where the task names no such place.

    It is necessary for success, and not sufficient. None, too, where actions are targets of servos,
    over which no search is made.
    """
    edge = getattr(setup.task, "goal_edge", None)
    if edge is None or isinstance(setup.plant, ServoPlant):
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
        limits: of every control, N m or N, shape (starts,); by default the task's.
    """
    timing, engine = setup.timing, setup.engine
    shares = np.array(list(product(CONTROLS, repeat=len(setup.plant.controls))))
    most = np.array(setup.largest_controls) if limits is None else limits[:, None, None]
    controls = np.broadcast_to(shares * most, (len(starts), *shares.shape))
    states = np.asarray(starts, dtype=np.float64)
    energy = first = energy_at(setup, states)
    highest, time = energy, np.where(energy >= required, 0.0, np.inf)
    given = residual = np.zeros(len(states))
    path, taken = [states], []
    tried = tuple(controls.reshape(-1, shares.shape[1]).T)
    places = np.arange(len(states))
    for decision in range(1, round(horizon / timing.control_period) + 1):
        q, v = split_state(tuple(np.repeat(states, len(shares), axis=0).T))
        motion = engine.advance(ARRAY, q, v, ((tried, timing.substeps),), None)
        ends = np.stack(join_state(motion.q, motion.v), axis=-1)
        energies = np.nan_to_num(energy_at(setup, ends), nan=-np.inf).reshape(len(states), -1)
        best = energies.argmax(axis=1)
        states = ends.reshape(len(states), len(shares), -1)[places, best]
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
        raise InputError(f"{type(setup.task).__name__} names no goal at rest: no `goal_edge`")

    def enough(limits: list[float]) -> dict[float, bool]:
        starts = np.tile(start, (len(limits), 1))
        times = reach(setup, starts, deadline, required, np.array(limits)).time
        return dict(zip(limits, np.isfinite(times).tolist(), strict=True))

    if not enough([high])[high]:
        raise InputError(f"the goal's energy is not reached within {deadline:g} s with {high:g}")
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
