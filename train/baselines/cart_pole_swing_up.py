"""The hand-made controller of the cart-pole's swing-up."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from integ_gym.envs.ops.ops import ARRAY
from integ_gym.envs.plants.cart_pole import CartPole
from integ_gym.envs.settings import Setup
from integ_gym.envs.tasks import CartPoleSwingUp

from .handmade import HandMade, caught, held, linearized, lqr

_DIRECTIONS = 64
"""How many directions of the state space the regulator is tried in."""


class CartPoleEnergyShaping(HandMade[CartPole]):
    r"""Swing-up of the cart-pole: energy shaping with a centred cart, then a regulator.

    *Below*, the force is the one that gives the cart the acceleration

    .. math::
        a = \operatorname{sat}(3 g (E - E_{up}) / E_{up}) \operatorname{sgn}(\dot\theta \cos\theta)
        - 2 T \cos\theta / (m l) - \omega^2 x - 2 \omega \dot x,

    saturated. The first term raises the energy E of the pole about its hinge towards that of
    standing upright, since :math:`\dot E = -m l \cos\theta\, \dot\theta\, a - T \dot\theta` with T
    the torque of damping and friction, for which the second makes up on average. The others draw
    the cart to the middle, more slowly than the pole swings.

    *Near the top*, :math:`F = -K x`, saturated, with K the discrete LQR gain of the plant
    linearized upright and held exactly over the control period. It takes over where its
    cost-to-go :math:`x^\top P x` is below a level that is found at construction: from every
    sampled state on that ellipsoid and on smaller ones the regulated plant, stops and force limit
    included, comes to rest upright.

    Source: Åström and Furuta (2000), *Swinging up a pendulum by energy control*, Automatica 36;
    Chung and Hauser (1995), *Nonlinear control of a swinging pendulum*, Automatica 31.

    Args:
        setup: of the environment.
    """

    plant_class = CartPole

    def __init__(self, setup: Setup) -> None:
        super().__init__(setup)
        plant, task = self.plant, setup.task
        assert isinstance(task, CartPoleSwingUp)
        self.track = float(task.track_limit)
        self.rate = math.sqrt(plant.mass_moment * plant.gravity / plant.inertia)
        scales = np.array([0.5 * self.track, self.track * self.rate, 0.3, 0.3 * self.rate])
        a, b = held(*linearized(plant), self.period)
        effort = np.array([[self.limit**-2.0]])
        self.gain, self.cost = lqr(a, b, np.diag(scales**-2.0), effort)
        self.level = self._caught_level()

    def parameters(self) -> dict[str, Any]:
        """The plant, the force limit, the length of the track and the control period."""
        return {**super().parameters(), "track": self.track}

    def control(self, observations: NDArray[np.float64]) -> NDArray[np.float64]:
        """Forces in N, shape (n,), of (x, ẋ, cos θ, sin θ, θ̇) in SI units, shape (n, 5)."""
        x, x_dot, cosine, sine, theta_dot = observations.T
        state = np.array([x, x_dot, np.arctan2(sine, cosine), theta_dot])
        near = self._cost_to_go(state) <= self.level
        return np.where(near, self.regulate(state), self.pump(state))

    def regulate(self, state: NDArray[Any]) -> NDArray[np.float64]:
        """Saturated LQR forces in N, shape (n,), of states of shape (4, n)."""
        return self.saturated(-(self.gain @ state)[0])

    def pump(self, state: NDArray[Any]) -> NDArray[np.float64]:
        """Energy-shaping forces in N, shape (n,), of states of shape (4, n)."""
        plant, (x, x_dot, theta, theta_dot) = self.plant, state
        upright = 2.0 * plant.mass_moment * plant.gravity
        still = np.zeros_like(x)
        energy = plant.energy(ARRAY, (x, theta), (still, theta_dot))
        fastest = self.limit / plant.total_mass
        wanted = 3.0 * plant.gravity * (energy - upright) / upright
        cosine, slow = np.cos(theta), 0.3 * self.rate
        resistance = plant.damping * theta_dot + plant.friction * np.sign(theta_dot)
        acceleration = np.clip(wanted, -0.7 * fastest, 0.7 * fastest)
        acceleration *= np.copysign(1.0, theta_dot * cosine)
        acceleration -= 2.0 * cosine * resistance / plant.mass_moment
        acceleration -= slow * (slow * x + 2.0 * x_dot)
        free, driven = (
            plant.acceleration(ARRAY, (x, theta), (x_dot, theta_dot), (force, 0.0))[0]
            for force in (0.0, 1.0)
        )
        return self.saturated((acceleration - free) / (driven - free))

    def _cost_to_go(self, state: NDArray[Any]) -> NDArray[np.float64]:
        cost: NDArray[np.float64] = np.einsum("in,ij,jn->n", state, self.cost, state)
        return cost

    def _caught_level(self) -> float:
        """Largest cost-to-go of a ladder up to which the regulator catches every sampled state."""
        directions = np.random.default_rng(0).normal(size=(4, _DIRECTIONS))
        directions /= np.sqrt(self._cost_to_go(directions))
        widest = 1.0 / np.linalg.inv(self.cost)[2, 2]  # where the ellipsoid reaches 1 rad
        levels = widest * np.linspace(0.1, 1.0, 19) ** 2
        starts = directions[:, :, None] * np.sqrt(levels)
        held_upright = caught(
            self.plant,
            self.regulate,
            starts.reshape(4, -1),
            period=self.period,
            rate=self.rate,
            limits=(self.track,),
        )
        every = held_upright.reshape(_DIRECTIONS, -1).all(axis=0)
        return float(levels[: int(np.cumprod(every).sum())].max(initial=0.0))
