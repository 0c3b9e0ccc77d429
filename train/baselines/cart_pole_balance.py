"""The hand-made controller of the cart-pole's balance."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from integ_gym.envs.plants.cart_pole import CartPole
from integ_gym.envs.settings import Setup
from integ_gym.envs.tasks import CartPoleBalance

from .handmade import HandMade, held, linearized, lqr_gain


class BangBangRegulator(HandMade[CartPole]):
    r"""Balance of the cart-pole: the linear-quadratic regulator's force, rounded to ±F.

    With K the discrete LQR gain of the plant linearized upright and held exactly over the control
    period, the action pushes towards +x where :math:`-Kx > 0`, else towards -x. Of the two forces
    this is the one after which the LQR's cost-to-go :math:`x^\top P x` is least, because
    :math:`Kx` is a positive multiple of :math:`B^\top P A x`. The pole keeps rocking by about
    what one push does.

    Args:
        setup: of the environment.
    """

    plant_class = CartPole

    def __init__(self, setup: Setup) -> None:
        super().__init__(setup)
        plant, task = self.plant, setup.task
        assert isinstance(task, CartPoleBalance)
        self.thresholds = (task.x_threshold, task.theta_threshold)
        rate = math.sqrt(plant.gravity / plant.length)
        scales = np.outer(self.thresholds, (1.0, rate)).ravel()
        a, b = held(*linearized(plant), self.period)
        self.gain = lqr_gain(a, b, np.diag(scales**-2.0), np.array([[self.limit**-2.0]]))[0]

    def parameters(self) -> dict[str, Any]:
        """The plant, the force, the control period and the thresholds that scale the cost."""
        return {**super().parameters(), "thresholds": self.thresholds}

    def act(self, observations: NDArray[Any]) -> NDArray[np.int64]:
        """Actions.

        Args:
            observations: (x, ẋ, θ, θ̇), shape (n, 4), SI units.

        Returns:
            1 (towards +x) or 0 (towards -x), int64 of shape (n,).
        """
        return np.where(self.control(np.asarray(observations, dtype=np.float64)) > 0.0, 1, 0)

    def control(self, observations: NDArray[np.float64]) -> NDArray[np.float64]:
        """The regulator's forces in N, not saturated, shape (n,), of (x, ẋ, θ, θ̇), shape (n, 4)."""
        force: NDArray[np.float64] = -(observations @ self.gain)
        return force
