"""Hand-made controller of the quadrotor, at rest and from way-point to way-point."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from integ_gym.envs.plants.quadrotor import Quadrotor
from integ_gym.envs.settings import Setup
from integ_gym.envs.tasks.interface import NEAR_UPRIGHT

from .controllers import HandMade, discretize_zoh, linearize, lqr_gain

_FARTHEST = 0.6
"""Distance from the target beyond which the regulator acts as at this one, m: its tilt stays small
enough for what is linear about hovering."""

_SCALES = (0.3, 0.6, 0.3, 0.6, NEAR_UPRIGHT, 2.0)
"""Deviations of (x, ẋ, z, ż, θ, θ̇) that cost as much as half the weight on a rotor, SI units."""


class HoverRegulator(HandMade[Quadrotor]):
    r"""Hovering of the quadrotor: a linear-quadratic regulator, saturated.

    :math:`u = \tfrac12 m g - K x` with K the discrete LQR gain of the plant linearized about
    hovering, lag of the rotors included, and held exactly over the control period. The state x has
    the body's coordinates and speeds and the thrusts' deviations. Distances count up to 0.6 m each.

    Args:
        setup: of the environment.
    """

    plant_class = Quadrotor

    def __init__(self, setup: Setup) -> None:
        super().__init__(setup)
        plant = self.plant
        self.share = 0.5 * plant.weight
        hovering = np.zeros(2 * len(plant.coordinates) + 2)
        hovering[[7, 9, -2, -1]] = self.share
        a, b = linearize(plant, hovering)
        self.lags = plant.motor_time_constant is not None
        kept = [*range(6), *((7, 9) if self.lags else ())]
        scales = np.array([*_SCALES, *((2.0 * self.share,) * 2 if self.lags else ())])
        gain = discretize_zoh(a[np.ix_(kept, kept)], b[kept], self.period)
        self.gain = lqr_gain(*gain, np.diag(scales**-2.0), np.eye(2) * self.share**-2.0)

    def control(self, observations: NDArray[np.float64]) -> NDArray[np.float64]:
        """Thrusts in N, shape (n, 2), of the task's observations, shape (n, 9), SI units."""
        x, x_dot, z, z_dot, cosine, sine, turning, left, right = observations.T
        x, z = (np.clip(distance, -_FARTHEST, _FARTHEST) for distance in (x, z))
        thrusts = (left - self.share, right - self.share) if self.lags else ()
        state = np.array([x, x_dot, z, z_dot, np.arctan2(sine, cosine), turning, *thrusts])
        within: NDArray[np.float64] = np.clip(self.share - (self.gain @ state).T, 0.0, self.limit)
        return within
