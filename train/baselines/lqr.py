"""Linear-quadratic regulators around upright, designed from a plant's own parameters."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from integ_gym.envs.ops.ops import SCALAR
from integ_gym.envs.plants.interface import Plant, join_state, split_state
from integ_gym.support.packages.extras import load

Matrix: TypeAlias = NDArray[np.float64]

_STEP = 1e-5
"""Half-width of the central differences: their error is below 1e-9 on our plants."""


def linearized(plant: Plant) -> tuple[Matrix, Matrix]:
    """ẋ = A x + B u of a plant near rest upright without control.

    Args:
        plant: with numbers, not arrays, as parameters.

    Returns:
        A of shape (n, n) and B of shape (n, 1), in the state order and SI units of the plant.
    """
    n = 2 * len(plant.coordinates)

    def rate(point: Matrix) -> Matrix:
        q, v = split_state(tuple(point[:n].tolist()))
        force = [0.0] * len(q)
        force[plant.actuated] = float(point[n])
        return np.array(join_state(v, plant.acceleration(SCALAR, q, v, tuple(force))))

    slopes = [(rate(_STEP * e) - rate(-_STEP * e)) / (2.0 * _STEP) for e in np.eye(n + 1)]
    jacobian = np.column_stack(slopes)
    return jacobian[:, :n], jacobian[:, n:]


def held(a: Matrix, b: Matrix, period: float) -> tuple[Matrix, Matrix]:
    """The exact discrete map of ẋ = A x + B u with u held constant over ``period`` seconds.

    Source: Van Loan (1978), Computing integrals involving the matrix exponential.
    """
    expm = load("scipy.linalg", "report").expm
    n, m = b.shape
    block = np.zeros((n + m, n + m))
    block[:n, :n], block[:n, n:] = a, b
    exponential = np.asarray(expm(period * block), dtype=np.float64)
    return exponential[:n, :n], exponential[:n, n:]


def lqr_gain(a: Matrix, b: Matrix, state_cost: Matrix, control_cost: Matrix) -> Matrix:
    """K, shape (m, n), of :func:`lqr`."""
    return lqr(a, b, state_cost, control_cost)[0]


def lqr(a: Matrix, b: Matrix, state_cost: Matrix, control_cost: Matrix) -> tuple[Matrix, Matrix]:
    """K of the control u = -K x that minimizes Σ xᵀ Q x + uᵀ R u over x ← A x + B u, and its cost.

    Args:
        a: shape (n, n).
        b: shape (n, m).
        state_cost: Q, shape (n, n), positive semidefinite.
        control_cost: R, shape (m, m), positive definite.

    Returns:
        K of shape (m, n), and P of shape (n, n): the least sum from x on is xᵀ P x.

    Raises:
        ValueError: if no control stabilizes the system.
    """
    linalg = load("scipy.linalg", "report")
    try:
        value = linalg.solve_discrete_are(a, b, state_cost, control_cost)
    except np.linalg.LinAlgError as error:
        raise ValueError(
            "no linear control holds this plant upright; give it gravity and a control that acts"
        ) from error
    gain = np.linalg.solve(control_cost + b.T @ value @ b, b.T @ value @ a)
    return np.asarray(gain), np.asarray(value)
