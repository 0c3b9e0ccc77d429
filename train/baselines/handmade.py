"""What hand-made controllers share: linear-quadratic regulators and where they catch."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict
from typing import TYPE_CHECKING, Any, ClassVar, Generic, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from integ_gym.envs.engines.native import NativeEngine
from integ_gym.envs.mechanics import PlantSystem
from integ_gym.envs.ops.array_ops import ARRAY
from integ_gym.envs.ops.ops import SCALAR
from integ_gym.envs.plants.interface import Plant, join_state, split_state
from integ_gym.envs.settings import Setup
from integ_gym.support.errors import InputError
from integ_gym.support.optional import load

from ..policy import ActionArray
from .making import Baseline

if TYPE_CHECKING:
    from _typeshed import DataclassInstance


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
        raise InputError(
            "no linear control holds this plant upright; give it gravity and a control that acts"
        ) from error
    gain = np.linalg.solve(control_cost + b.T @ value @ b, b.T @ value @ a)
    return np.asarray(gain), np.asarray(value)


_CATCH_TIME = 4.0
"""How long the regulator may take, in simulation, to bring a state near upright, s."""
_CATCH_ANGLE = 0.1
"""How near upright it must then be, rad."""
_STEP_RATE = 0.1
"""Largest integration step of that simulation times the rate of the plant."""


def caught(
    plant: Plant,
    regulate: Callable[[NDArray[Any]], NDArray[np.float64]],
    state: NDArray[np.float64],
    *,
    period: float,
    rate: float,
    limits: tuple[float, ...] = (),
) -> NDArray[np.bool_]:
    """Whether the regulated plant comes to rest upright from some states.

    Args:
        plant: whose last coordinate is the angle from upright, rad.
        regulate: controls in N or N m, shape (n,), of states.
        state: where the plant starts, in its state order and SI units, shape (2 coordinates, n).
        period: control period, s.
        rate: of the plant's pendulum, rad/s.
        limits: of the coordinates before the angle, which are not to be left, SI units.

    Returns:
        Shape (n,).
    """
    substeps = math.ceil(period * rate / _STEP_RATE)
    engine = NativeEngine(PlantSystem(plant), "rk4", period / substeps)
    kept = np.array([*limits, 0.5 * math.pi])[:, None]
    inside = np.ones(state.shape[1], dtype=bool)
    for _ in range(math.ceil(_CATCH_TIME / period)):
        q, v = split_state(tuple(state))
        motion = engine.advance(ARRAY, q, v, ((regulate(state), substeps),), None)
        state = np.array(join_state(motion.q, motion.v))
        inside &= (np.abs(np.array(motion.q)) <= kept).all(axis=0)
    near: NDArray[np.bool_] = inside & (np.abs(state[-2]) < _CATCH_ANGLE)
    return near


P = TypeVar("P", bound="DataclassInstance")


class HandMade(Baseline, Generic[P]):
    """A controller that is designed from a plant's own parameters, for one task.

    Args:
        setup: of the environment.
    """

    policy_id = "handmade"
    plant_class: ClassVar[type[Any]]
    """Class of the plant that the task has; the module is named as the task's."""

    def __init__(self, setup: Setup) -> None:
        assert isinstance(setup.plant, self.plant_class)
        self.plant: P = setup.plant
        self.limit = float(setup.task.control_limit)
        self.period = setup.timing.control_period

    def parameters(self) -> dict[str, Any]:
        """The plant, the limit of the control and the control period."""
        return {"plant": asdict(self.plant), "limit": self.limit, "period": self.period}

    def act(self, observations: NDArray[Any]) -> ActionArray:
        """Actions of a `Box` space.

        Args:
            observations: shape (n, obs_dim), SI units.

        Returns:
            The controls, float32 of shape (n, 1).
        """
        controls = self.control(np.asarray(observations, dtype=np.float64))
        return controls.astype(np.float32)[:, None]

    def control(self, observations: NDArray[np.float64]) -> NDArray[np.float64]:
        """Controls in N or N m, shape (n,), of observations of shape (n, obs_dim)."""
        raise NotImplementedError

    def saturated(self, control: NDArray[np.float64]) -> NDArray[np.float64]:
        """Controls within the limit."""
        within: NDArray[np.float64] = np.clip(control, -self.limit, self.limit)
        return within
