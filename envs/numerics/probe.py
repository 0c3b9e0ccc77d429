"""Where and how finely to look at a plant that nothing else is known of."""

from __future__ import annotations

import numpy as np

from ..arithmetic.array_ops import ARRAY
from ..mechanics.system import PlantSystem
from ..plants.interface import Plant, join_state, split_state
from .stepping import Array, State, jacobian


def probe_state(plant: Plant) -> Array:
    """A state away from rest and from symmetries, SI units, shape (n,)."""
    n = len(plant.coordinates)
    q = [0.7 + 0.4 * i for i in range(n)]
    v = [0.5 - 0.3 * i for i in range(n)]
    return np.array(join_state(tuple(q), tuple(v)))


def fastest_rate(plant: Plant, state: State | None = None) -> float:
    """The largest of :func:`linear_rates`, rad/s."""
    return float(linear_rates(plant, state)[-1])


def linear_rates(plant: Plant, state: State | None = None) -> Array:
    """|eigenvalues| of the plant's linearization at a state, without control, rad/s, ascending.

    Args:
        plant: with numbers as parameters.
        state: shape (n,); None: :func:`probe_state`.
    """
    found: Array = np.sort(np.abs(np.linalg.eigvals(_linearized(plant, state))))
    return found


def fastest_mode(plant: Plant, state: State) -> Array:
    """Shape of the fastest small motion about a rest state, without control.

    Args:
        plant: with numbers as parameters.
        state: shape (n,), in state order.

    Returns:
        Displacements of the coordinates, the largest 1, shape (n / 2,).
    """
    linear = _linearized(plant, state)
    rates = np.linalg.eigvals(linear)
    fastest = rates[np.argmax(np.abs(rates))]
    # The null vector by singular values: eigenvectors are poor beside a cart that rolls freely.
    shape = np.linalg.svd(linear - fastest * np.eye(len(linear)))[2][-1].conj()[0::2]
    largest = np.argmax(np.abs(shape))
    turned: Array = (shape * shape[largest].conj()).real
    mode: Array = turned / turned[largest]
    return mode


def _linearized(plant: Plant, state: State | None) -> Array:
    """∂(v, a)/∂(q, v) in state order, shape (n, n)."""
    system = PlantSystem(plant)

    def rates(points: Array) -> Array:
        q, v = split_state(tuple(points.T))
        acceleration, _ = system.rates(ARRAY, q, v, 0.0)
        columns = join_state(v, acceleration)
        return np.stack([np.broadcast_to(x, v[0].shape) for x in columns], -1)

    point = probe_state(plant) if state is None else np.asarray(state, dtype=np.float64)
    return jacobian(rates, point)
