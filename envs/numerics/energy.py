"""What an integrator does to energy: of a free motion, and of a driven one with its ledger."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ..arithmetic.ops import SCALAR
from ..engines.interface import Motion
from ..engines.native import NativeEngine
from ..mechanics.system import PlantSystem
from ..plants.interface import Plant, join_state, split_state
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
            where the two cannot yet be told apart (total change below 10 %).
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
        controls: one per control period, in the plant's unit.
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
        motion = engine.advance(SCALAR, q, v, ((float(control), substeps),), None)
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
