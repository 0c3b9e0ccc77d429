"""Where and how finely to look at a plant that nothing else is known of."""

from __future__ import annotations

import numpy as np

from integ_gym.envs.array_ops import ARRAY
from integ_gym.envs.numerics.stepping import Array, State, jacobian
from integ_gym.envs.plants.interface import Plant, join_state, split_state
from integ_gym.envs.system import PlantSystem


def probe_state(plant: Plant) -> Array:
    """A state away from rest and from symmetries, SI units, shape (n,)."""
    n = len(plant.coordinates)
    q = [0.7 + 0.4 * i for i in range(n)]
    v = [0.5 - 0.3 * i for i in range(n)]
    return np.array(join_state(tuple(q), tuple(v)))


def fastest_rate(plant: Plant, state: State | None = None) -> float:
    """Largest |eigenvalue| of the plant's linearization at a state, without control, rad/s.

    Args:
        plant: with numbers as parameters.
        state: shape (n,); None: :func:`probe_state`.
    """
    system = PlantSystem(plant)

    def rates(points: Array) -> Array:
        q, v = split_state(tuple(points.T))
        acceleration, _ = system.rates(ARRAY, q, v, 0.0)
        columns = join_state(v, acceleration)
        return np.stack([np.broadcast_to(x, v[0].shape) for x in columns], -1)

    point = probe_state(plant) if state is None else np.asarray(state, dtype=np.float64)
    return float(np.abs(np.linalg.eigvals(jacobian(rates, point))).max())
