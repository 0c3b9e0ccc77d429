"""The hand-made controller of the pendulum's swing-up."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from integ_gym.envs.ops.ops import ARRAY
from integ_gym.envs.plants.pendulum import Pendulum
from integ_gym.envs.settings import Setup
from integ_gym.envs.tasks import wrap_angle

from .handmade import HandMade, caught, held, linearized, lqr_gain


class EnergyShaping(HandMade[Pendulum]):
    r"""Swing-up of the pendulum: energy shaping below, a linear-quadratic regulator near the top.

    *Below*, the torque is the one whose work over the coming control period would bring the
    pendulum's energy to that of standing upright, saturated:
    :math:`\tau = -(E - E_{up}) / (\bar\omega T) + b\bar\omega` with :math:`\bar\omega` the mean
    speed expected over the period. It pumps at full torque while energy is missing, brakes where
    there is too much, and leaves the pendulum on the orbit that runs into the upright equilibrium.

    *Near the top*, :math:`\tau = -K x` with K the discrete LQR gain of the plant linearized upright
    and held exactly over the control period. It takes over inside its own region of attraction,
    torque limit included: at construction the regulated plant is simulated from a grid of states,
    and those from which it comes to rest upright form the region.

    Source: Åström and Furuta (2000), *Swinging up a pendulum by energy control*, Automatica 36.

    Args:
        setup: of the environment.
    """

    plant_class = Pendulum

    def __init__(self, setup: Setup) -> None:
        super().__init__(setup)
        plant = self.plant
        self.rate = math.sqrt(plant.gravity_torque / plant.inertia)
        a, b = held(*linearized(plant), self.period)
        weights = np.diag([1.0, 1.0 / self.rate**2])
        effort = np.array([[1.0 / plant.gravity_torque**2]])
        self.gain = lqr_gain(a, b, weights, effort)[0]
        self.region = _Region.of(self)

    def control(self, observations: NDArray[np.float64]) -> NDArray[np.float64]:
        """Torques in N m, shape (n,), of (cos θ, sin θ, θ̇ in rad/s), shape (n, 3)."""
        cosine, sine, speed = observations.T
        angle = np.arctan2(sine, cosine)
        return np.where(
            self.region.holds(angle, speed), self.regulate(angle, speed), self.pump(angle, speed)
        )

    def regulate(self, angle: NDArray[Any], speed: NDArray[Any]) -> NDArray[np.float64]:
        """Saturated LQR torques in N m, shape (n,), of angles in rad and speeds in rad/s."""
        return self.saturated(-(self.gain[0] * angle + self.gain[1] * speed))

    def pump(self, angle: NDArray[Any], speed: NDArray[Any]) -> NDArray[np.float64]:
        """Energy-shaping torques in N m, shape (n,), of angles in rad and speeds in rad/s."""
        plant, period = self.plant, self.period
        (free,) = plant.acceleration(ARRAY, (angle,), (speed,), (0.0,))
        mean_speed = speed + 0.5 * period * free
        excess = plant.energy(ARRAY, (angle,), (speed,)) - 2.0 * plant.gravity_torque
        floor = np.copysign(1e-9, mean_speed)
        advance = period * np.where(np.abs(mean_speed) < 1e-9, floor, mean_speed)
        return self.saturated(-excess / advance + plant.damping * mean_speed)


class _Region:
    """States (θ, θ̇) from which the regulator brings a pendulum to rest upright.

    Args:
        angles: grid over θ, rad, ascending and evenly spaced, shape (rows,).
        speeds: grid over θ̇, rad/s, likewise, shape (columns,).
        caught: whether each grid point belongs to the region, shape (rows, columns).
    """

    def __init__(
        self, angles: NDArray[Any], speeds: NDArray[Any], caught: NDArray[np.bool_]
    ) -> None:
        self.angles, self.speeds = angles, speeds
        self.cells = caught[:-1, :-1] & caught[1:, :-1] & caught[:-1, 1:] & caught[1:, 1:]

    @classmethod
    def of(cls, controller: EnergyShaping) -> _Region:
        """Simulate the regulated plant from a grid of states."""
        angles = np.linspace(-1.0, 1.0, 61)
        speeds = np.linspace(-2.0 * controller.rate, 2.0 * controller.rate, 61)
        states = np.array([grid.ravel() for grid in np.meshgrid(angles, speeds, indexing="ij")])
        held_upright = caught(
            controller.plant,
            lambda state: controller.regulate(wrap_angle(ARRAY, state[0]), state[1]),
            states,
            period=controller.period,
            rate=controller.rate,
        )
        return cls(angles, speeds, held_upright.reshape(len(angles), len(speeds)))

    def holds(self, angle: NDArray[Any], speed: NDArray[Any]) -> NDArray[np.bool_]:
        """Whether states lie in a grid cell whose four corners are caught; shape (n,)."""
        rows, row_inside = _cell(self.angles, angle)
        columns, column_inside = _cell(self.speeds, speed)
        inside: NDArray[np.bool_] = row_inside & column_inside & self.cells[rows, columns]
        return inside


def _cell(grid: NDArray[Any], values: NDArray[Any]) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Index of the interval that each value lies in, and whether it lies in the grid at all."""
    position = (values - grid[0]) / (grid[1] - grid[0])
    inside = (position >= 0.0) & (position < len(grid) - 1)
    return np.where(inside, position, 0.0).astype(np.int64), inside
