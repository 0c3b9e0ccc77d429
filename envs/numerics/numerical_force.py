"""How much a discretization disturbs a motion, in units of what the control can do about it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arithmetic import ARRAY
from ..episode import Setup
from ..plants import split_state
from .stepping import Array


@dataclass(frozen=True)
class Disturbance:
    """What a discretization adds to each control period of a motion on the truth.

    Attributes:
        force: root mean square of the change of velocity that it adds, over what the full control
            changes in the same time; dimensionless.
        power: mean of the energy that it adds, over what the full control would work in the same
            time; dimensionless, negative where it drains.
        coherence: of the energy that it adds and takes, the share that is left over the motion: 1
            where it only pumps or only drains, 0 where it takes back all that it gives.
    """

    force: float
    power: float
    coherence: float


def disturbance(truth: Setup, discretized: Setup, states: Array, controls: Array) -> Disturbance:
    """Hold one control period of a discretization against the truth, from state to state.

    Velocities of all coordinates are compared, each weighed by itself.

    Args:
        truth: setup of the truth; its control limit is what is compared with.
        discretized: the same in a discretization.
        states: true states, shape (m, n), in state order.
        controls: held from each on, N m or N, shape (m,).
    """
    limit = float(truth.task.control_limit)
    exact, exact_energy = _after(truth, states, controls)
    moved, moved_energy = _after(discretized, states, controls)
    pushed, _ = _after(truth, states, controls - np.copysign(limit, controls))
    force = np.sqrt(((moved - exact) ** 2).sum() / ((pushed - exact) ** 2).sum())
    displaced = np.abs(exact[:, truth.plant.actuated]) * truth.timing.control_period
    added = moved_energy - exact_energy
    power = added.sum() / (limit * displaced.sum())
    exchanged = np.abs(added).sum()
    coherence = abs(added.sum()) / exchanged if exchanged else 1.0
    return Disturbance(float(force), float(power), float(coherence))


def _after(setup: Setup, states: Array, controls: Array) -> tuple[Array, Array]:
    """Velocities (m, n / 2) and energies (m,), J, one control period later."""
    q, v = split_state(tuple(states.T))
    with np.errstate(all="ignore"):
        motion = setup.engine.advance(ARRAY, q, v, ((controls, setup.timing.substeps),), None)
        energy = np.asarray(setup.system.energy(ARRAY, motion.q, motion.v))
    return np.stack(motion.v, axis=-1), energy
