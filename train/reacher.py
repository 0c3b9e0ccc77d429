"""Hand-made controller of the reacher."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from integ_gym.envs.ops.ops import ARRAY
from integ_gym.envs.plants.double_pendulum import ReachingArm
from integ_gym.envs.tasks.reacher import MARKER_CENTRE

from .controllers import HandMade

_TIME = 0.01
"""Half-width of the central differences in time, s."""


class InverseKinematics(HandMade[ReachingArm]):
    r"""Targets that take the tip along the marker's way, by inverse kinematics and dynamics.

    The marker is turned on along its circle to the middle of the coming control period. The joints
    that reach it there are :math:`q_d(t)`, the elbow always on the same side, and the targets

    .. math:: q^* = q_d + (k_d \dot q_d + \tau_d) / k_p,

    with :math:`\tau_d` the torques under which the arm follows :math:`q_d`: the servos give these
    where the arm is on its way.

    Source: Siciliano, Sciavicco, Villani and Oriolo (2009), *Robotics: modelling, planning and
    control*, sections 2.12 and 8.5.

    Args:
        setup: of the environment.
    """

    plant_class = ReachingArm

    def control(self, observations: NDArray[np.float64]) -> NDArray[np.float64]:
        """Targets in rad, shape (n, 2), of observations in SI units, shape (n, 10)."""
        place, velocity = observations[:, 6:8].T, observations[:, 8:10].T
        arm = place - np.array(MARKER_CENTRE)[:, None]
        rate = (arm[0] * velocity[1] - arm[1] * velocity[0]) / (arm * arm).sum(axis=0)
        now = 0.5 * self.period
        before, q, after = (self._joints(arm, rate * (now + t)) for t in (-_TIME, 0.0, _TIME))
        v, a = (after - before) / (2.0 * _TIME), (after - 2.0 * q + before) / _TIME**2
        moved = (*q, rate), (*v, rate)
        free = self.plant.acceleration(ARRAY, *moved, (0.0, 0.0, 0.0))
        (one, both, _), (_, two, _), _ = self.plant.mass_matrix(ARRAY, moved[0])
        lacking = a - np.array(free[:2])
        torques = np.array(
            [one * lacking[0] + both * lacking[1], both * lacking[0] + two * lacking[1]]
        )
        servo: Any = self.plant
        targets = q + (servo.servo_damping * v + torques) / servo.servo_stiffness
        return self.saturated(targets.T)

    def _joints(self, arm: NDArray[np.float64], turn: NDArray[np.float64]) -> NDArray[np.float64]:
        """(θ₁, θ₂), shape (2, n), with the tip where the marker is when it has turned by an angle.

        Where that is out of reach the arm is straight towards it.
        """
        cosine, sine = np.cos(turn), np.sin(turn)
        x = MARKER_CENTRE[0] + cosine * arm[0] - sine * arm[1]
        z = MARKER_CENTRE[1] + sine * arm[0] + cosine * arm[1]
        first, second = self.plant.length_1, self.plant.length_2
        bent = (x * x + z * z - first * first - second * second) / (2.0 * first * second)
        elbow = np.arccos(np.clip(bent, -1.0, 1.0))
        inner = np.arctan2(second * np.sin(elbow), first + second * np.cos(elbow))
        return np.array([np.arctan2(x, -z) - inner, elbow])
