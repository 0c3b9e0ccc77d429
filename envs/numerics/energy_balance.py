"""Whether work, losses and the change of energy agree."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..arithmetic import SCALAR
from ..engines import NativeEngine
from ..mechanics import PlantSystem
from ..plants import Plant, join_state, split_state
from .stepping import Array, State


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
    engine = NativeEngine(system, integrator, control_period / substeps)
    q, v = split_state(tuple(float(x) for x in state))
    energy = [system.energy(SCALAR, q, v)]
    work, losses, clipped = [], [], []
    for control in controls:
        motion = engine.advance(SCALAR, q, v, ((float(control), substeps),), None)
        q, v = motion.q, motion.v
        energy.append(system.energy(SCALAR, q, v))
        work.append(motion.work)
        losses.append(sum(motion.losses))
        clipped.append(motion.clip_loss)
    residuals = np.diff(energy) - np.array(work) + np.array(losses) + np.array(clipped)
    return Ledger(
        state=np.array(join_state(q, v)),
        energy_change_j=energy[-1] - energy[0],
        work_j=float(np.sum(work)),
        losses_j=float(np.sum(losses)),
        clip_loss_j=float(np.sum(clipped)),
        residuals_j=residuals,
    )
