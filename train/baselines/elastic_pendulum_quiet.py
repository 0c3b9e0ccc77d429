"""The hand-made controller of the elastic pendulum."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from integ_gym.envs.plants.elastic_pendulum import ElasticPendulum
from integ_gym.envs.settings import Setup
from integ_gym.envs.tasks import NEAR_PLUMB

from .handmade import HandMade, held, linearized, lqr_gain


class SwingRegulator(HandMade[ElasticPendulum]):
    r"""Quieting of the elastic pendulum: the linear-quadratic regulator of its swing, saturated.

    :math:`F = -K (x, \dot x)` with K the discrete LQR gain of the swing, linearized at rest and
    held exactly over the control period. A horizontal force does not reach the bounce of a
    hanging spring, which is left alone.

    Args:
        setup: of the environment.
    """

    plant_class = ElasticPendulum

    def __init__(self, setup: Setup) -> None:
        super().__init__(setup)
        plant = self.plant
        rate = math.sqrt(plant.gravity / plant.hanging_length)
        a, b = linearized(plant)
        swing = held(a[:2, :2], b[:2], self.period)
        weights = np.diag([1.0, rate**-2.0]) / NEAR_PLUMB**2
        self.gain = lqr_gain(*swing, weights, np.array([[self.limit**-2.0]]))[0]

    def control(self, observations: NDArray[np.float64]) -> NDArray[np.float64]:
        """Forces in N, shape (n,), of (x, ẋ, y, ẏ) in SI units, shape (n, 4)."""
        return self.saturated(-(observations[:, :2] @ self.gain))
