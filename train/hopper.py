"""Hand-made controller of the hopper."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from integ_gym.envs.plants.hopper import Hopper
from integ_gym.envs.settings import Setup
from integ_gym.envs.tasks.hopper import HopperRun

from .controllers import HandMade

_SWING_RATE, _TORSO_RATE = 30.0, 8.0
"""Natural frequencies, rad/s, of the leg's swing in the air and of the torso on the ground, both
critically damped."""

_PLACEMENT = 0.03
"""How far beyond the neutral point the foot is set per speed in excess, s."""

_APEX, _STROKE = 1.24, 0.067
"""Height of the hip at the top of a hop, and way over which a thrust adds what is missing to it,
leg lengths."""

_GRIP = 0.5
"""Share of the ground's friction that the hip may ask for."""


class HoppingInThreeParts(HandMade[Hopper]):
    r"""Raibert's controller: height by thrust, speed by where the foot is set, attitude by the hip.

    *In the air* the hip swings the leg so that the foot lands :math:`\dot x T/2 + k(\dot x - v)`
    before it, with :math:`T = \pi\sqrt{m/k_l}` the time on the ground. The first term is the
    neutral point, about which the torso is neither hastened nor slowed. *On the ground* the hip
    turns the torso upright, as far as friction lets it, and while the leg extends, a force along it
    adds the energy that the torso lacks for the height of the next hop.
    Source: Raibert (1986), *Legged Robots That Balance*, MIT Press, chapter 2; the thrust is by the
    energy, so that nothing is remembered from hop to hop.

    Args:
        setup: of the environment.
    """

    plant_class = Hopper

    def __init__(self, setup: Setup) -> None:
        super().__init__(setup)
        plant, task = self.plant, setup.task
        assert isinstance(task, HopperRun)
        self.limits = np.array(setup.largest_controls)
        self.speed = float(task.target_speed)
        self.stance = math.pi * math.sqrt(plant.mass / plant.leg_stiffness)

    def parameters(self) -> dict[str, Any]:
        """The plant, both limits, the commanded speed and the control period."""
        return {**super().parameters(), "limits": self.limits.tolist(), "speed": self.speed}

    def control(self, observations: NDArray[np.float64]) -> NDArray[np.float64]:
        """(Torque in N m, force in N), shape (n, 2), of observations of shape (n, 9), SI units."""
        plant, length = self.plant, self.plant.leg_length
        x_dot, z, z_dot, theta, theta_dot, hip, hip_dot, leg, leg_dot = observations.T
        angle, squeeze = hip - theta, np.maximum(length - leg, 0.0)
        ahead = 0.5 * self.stance * x_dot + _PLACEMENT * (x_dot - self.speed)
        away = np.arcsin(np.clip(ahead / length, -0.6, 0.6)) - angle
        swinging = _critical(_SWING_RATE, away, hip_dot - theta_dot)
        grip = _GRIP * plant.ground_friction * plant.leg_stiffness * squeeze * leg
        turning = plant.inertia * _critical(_TORSO_RATE, -theta, theta_dot)
        lands = z < leg * np.cos(angle)
        torque = np.where(
            lands, np.clip(turning, -grip, grip), plant.foot_mass * length**2 * swinging
        )
        weight = plant.mass * plant.gravity
        energy = weight * z + 0.5 * plant.mass * z_dot**2 + 0.5 * plant.leg_stiffness * squeeze**2
        missing = (weight * _APEX * length - energy) / (_STROKE * length)
        force = np.where(lands & (leg_dot > 0.0), missing, 0.0)
        within: NDArray[np.float64] = np.clip(
            np.stack([torque, force], axis=-1), -self.limits, self.limits
        )
        return within


def _critical(
    rate: float, away: NDArray[np.float64], speed: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Acceleration towards what is ``away``, critically damped."""
    return rate * (rate * away - 2.0 * speed)
