"""Hopping forward on one leg at a commanded speed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import inf
from typing import Any, ClassVar

from integ_gym.support.parameters import parameter, positive

from ..ops.ops import Component, Components, Ops
from .interface import BoxTask, Limits

LOWEST, STEEPEST = 0.3, 1.0
"""Height of the hip, m, and pitch, rad, beyond which a hopper has fallen."""

NEAR_SPEED, NEAR_PITCH = 0.4, 0.3
"""Goal: deviation from the commanded speed, m/s, and pitch, rad, below these."""

DISTANCE_TIME = 5.0
"""Goal: farther than one comes in this time at the commanded speed, s."""


@dataclass(frozen=True)
class HopperRun(BoxTask):
    """Hop forward at a commanded speed, upright.

    Reward rate up to 1 / 0.02 s, the more the nearer to the commanded speed and to upright.
    """

    target_speed: float = parameter(1.0, "m/s", "commanded forward speed", positive)
    max_torque: float = parameter(20.0, "N m", "limit of the hip's torque", positive)
    max_force: float = parameter(150.0, "N", "limit of the force along the leg", positive)

    plant: ClassVar[str] = "hopper"
    starts: ClassVar[tuple[str, ...]] = ("dropped",)
    start_options: ClassVar[tuple[str, ...]] = ()
    goal: ClassVar[str] = (
        "x > 5 s times the commanded speed, |theta| < 0.3 rad and x_dot within 0.4 m/s of that "
        "speed throughout the last 2 s"
    )
    goal_stay: ClassVar[float] = 2.0
    observation_names: ClassVar[tuple[str, ...]] = (
        "x_dot", "z", "z_dot", "theta", "theta_dot", "hip", "hip_dot", "leg", "leg_dot",
    )  # fmt: skip
    observation_units: ClassVar[tuple[str, ...]] = (
        "m/s", "m", "m/s", "rad", "rad/s", "rad", "rad/s", "m", "m/s",
    )  # fmt: skip

    @property
    def finish(self) -> Component:
        """Goal: farther than this, m."""
        return DISTANCE_TIME * self.target_speed

    @property
    def control_limits(self) -> Limits:
        """±`max_torque` of the hip, N m, and ±`max_force` along the leg, N."""
        return (-self.max_torque, self.max_torque), (-self.max_force, self.max_force)

    def observation_limits(self, max_speed: float | None) -> tuple[float, ...]:
        """Infinity for coordinates, and the speed limit or infinity."""
        speed = inf if max_speed is None else max_speed
        return (speed, *(inf, speed) * 4)

    def observe(self, ops: Ops, q: Components, v: Components) -> Components:
        """All of the state but x."""
        return v[0], q[1], v[1], q[2], v[2], q[3], v[3], q[4], v[4]

    def share(self, ops: Ops, q: Components, v: Components, squares: Components) -> Component:
        """Nearness to the commanded speed, upright, at the start times gentleness in the period."""
        late, tilt = (v[0] - self.target_speed) / NEAR_SPEED, q[2] / NEAR_PITCH
        torque, force = self.max_torque * self.max_torque, self.max_force * self.max_force
        effort = 0.5 * (squares[0] / torque + squares[1] / force)
        return (1.0 - 0.1 * effort) / (1.0 + late * late + tilt * tilt)

    def terminated(self, ops: Ops, q: Components, v: Components) -> Component:
        """Fallen: the hip too low, or the torso too far from upright."""
        return (q[1] < LOWEST) | (abs(q[2]) > STEEPEST)

    def at_goal(self, ops: Ops, q: Components, v: Components) -> Component:
        """Far enough, upright, and about as fast as commanded."""
        far = q[0] > self.finish
        return far & (abs(q[2]) < NEAR_PITCH) & (abs(v[0] - self.target_speed) < NEAR_SPEED)

    def draw_start(self, rng: Any, start: str, options: Mapping[str, Any]) -> Components:
        """Dropped at x = 0 with a leg of 0.5 m, the hip 0.55 to 0.65 m above the ground.

        Forward speed is 0 to 1 m/s, pitch and hip are within 0.1 rad and the pitch's speed within
        0.3 rad/s.
        """
        highs = [0.65, 1.0, 0.1, 0.3, 0.1]
        z, x_dot, theta, theta_dot, hip = rng.uniform(low=[0.55, 0.0, -0.1, -0.3, -0.1], high=highs)
        return 0.0, x_dot, z, 0.0, theta, theta_dot, hip, 0.0, 0.5, 0.0
