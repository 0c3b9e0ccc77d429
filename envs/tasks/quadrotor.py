"""Hovering and flying to way-points with a planar quadrotor."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import inf, isfinite, pi
from typing import Any, ClassVar

from integ_gym.support.errors import InputError
from integ_gym.support.parameters import parameter, positive

from ..ops.ops import Component, Components, Ops
from .interface import NEAR_UPRIGHT, SWING_TIME, BoxTask, Limits, read_number, wrap_angle

ROOM = 3.0
"""Half the width and height of the room that a quadrotor must not leave, m."""

NEAR_TARGET = 0.1
"""Goal: distance from the target below this, m."""

WAY_POINT = 0.5
"""Half the side of the square at whose corners the way-points are, m."""

HOVER_REACH = 0.5
"""Distance, and with `SWING_TIME` speed, at which half the reward of a hovering one is left, m."""


@dataclass(frozen=True)
class QuadrotorHover(BoxTask):
    """Fly a quadrotor that was thrown into a room to its middle, and hover there.

    Reward rate up to 1 / 0.02 s, the more the nearer to rest and level at the target.
    """

    max_thrust: float = parameter(6.0, "N", "largest thrust of each rotor", positive)

    plant: ClassVar[str] = "quadrotor"
    starts: ClassVar[tuple[str, ...]] = ("thrown",)
    start_options: ClassVar[tuple[str, ...]] = ("throw",)
    goal: ClassVar[str] = (
        "within 0.1 m of the target and |theta| < 0.2 rad (wrapped) throughout the last 2 s"
    )
    goal_stay: ClassVar[float] = 2.0
    observation_names: ClassVar[tuple[str, ...]] = (
        "x", "x_dot", "z", "z_dot", "cos_theta", "sin_theta", "theta_dot", "left_thrust",
        "right_thrust",
    )  # fmt: skip
    observation_units: ClassVar[tuple[str, ...]] = (
        "m", "m/s", "m", "m/s", "1", "1", "rad/s", "N", "N",
    )  # fmt: skip

    @property
    def control_limits(self) -> Limits:
        """0 to `max_thrust` of both rotors, N."""
        return ((0.0, self.max_thrust),) * 2

    def observation_limits(self, max_speed: float | None) -> tuple[float, ...]:
        """Infinity for both distances, 1 and 1, and the speed limit or infinity."""
        speed = inf if max_speed is None else max_speed
        return inf, speed, inf, speed, 1.0, 1.0, speed, speed, speed

    def observe(self, ops: Ops, q: Components, v: Components) -> Components:
        """(x, ẋ, z, ż, cos θ, sin θ, θ̇, thrusts of both rotors)."""
        return q[0], v[0], q[1], v[1], ops.cos(q[2]), ops.sin(q[2]), v[2], v[3], v[4]

    def share(self, ops: Ops, q: Components, v: Components, squares: Components) -> Component:
        """Nearness to level rest at the start of the period times gentleness in it."""
        speed_weight = SWING_TIME * SWING_TIME
        away = q[0] * q[0] + q[1] * q[1] + speed_weight * (v[0] * v[0] + v[1] * v[1])
        tilt = 2.0 * (1.0 - ops.cos(q[2])) + speed_weight * v[2] * v[2]
        full = self.max_thrust * self.max_thrust
        effort = 0.5 * (squares[0] + squares[1]) / full
        return (1.0 - 0.1 * effort) / (1.0 + away / (HOVER_REACH * HOVER_REACH) + tilt)

    def terminated(self, ops: Ops, q: Components, v: Components) -> Component:
        """Outside the room."""
        return (abs(q[0]) > ROOM) | (abs(q[1]) > ROOM)

    def at_goal(self, ops: Ops, q: Components, v: Components) -> Component:
        """At the target and level."""
        near = q[0] * q[0] + q[1] * q[1] < NEAR_TARGET * NEAR_TARGET
        return near & (abs(wrap_angle(ops, q[2])) < NEAR_UPRIGHT)

    def draw_start(self, rng: Any, start: str, options: Mapping[str, Any]) -> Components:
        """Anywhere within 1.5 m in x and z, tilted up to 0.5 rad, thrown, with idle rotors.

        Speeds are up to the option ``throw``, by default 1 m/s and 1 rad/s.
        """
        throw = read_number(options, "throw", 1.0)
        if not (isfinite(throw) and throw >= 0.0):
            raise InputError(f"reset option `throw` must be finite and 0 or above, got {throw}")
        ends = [1.5, throw, 1.5, throw, 0.5, throw]
        x, x_dot, z, z_dot, theta, theta_dot = rng.uniform(low=[-end for end in ends], high=ends)
        return x, x_dot, z, z_dot, theta, theta_dot, 0.0, 0.0, 0.0, 0.0


@dataclass(frozen=True)
class QuadrotorWayPoints(QuadrotorHover):
    """Fly a thrown quadrotor from one corner of a square to the next, and hover at each.

    The way-points are the corners, in turn and against the clock; see `target`. Reward and
    observation are those of :class:`QuadrotorHover`, seen from the way-point.
    """

    way_point_period: float = parameter(
        4.0, "s", "time for each way-point, half of it to fly there", positive
    )

    plant: ClassVar[str] = "guided_quadrotor"
    near_target: ClassVar[float] = NEAR_TARGET
    goal: ClassVar[str] = (
        "within 0.1 m of the way-point and |theta| < 0.2 rad (wrapped) throughout the second half "
        "of each way-point's time, in the last two times"
    )
    observation_names: ClassVar[tuple[str, ...]] = (
        "x_from_target", "x_dot", "z_from_target", *QuadrotorHover.observation_names[3:],
    )  # fmt: skip

    @property
    def goal_stay(self) -> float:  # type: ignore[override]
        """Twice `way_point_period`, s."""
        return 2.0 * self.way_point_period

    def target(self, ops: Ops, q: Components) -> tuple[Component, Component]:
        """Where the way-point is, (x, z) in m: the corner of the quadrant that the phase is in."""
        x, z = (
            ops.where(side > 0.0, WAY_POINT, -WAY_POINT) for side in (ops.cos(q[5]), ops.sin(q[5]))
        )
        return x, z

    def observe(self, ops: Ops, q: Components, v: Components) -> Components:
        """(x and z from the way-point with their speeds, cos θ, sin θ, θ̇, both thrusts)."""
        return super().observe(ops, self._from_guide(ops, q), v)

    def share(self, ops: Ops, q: Components, v: Components, squares: Components) -> Component:
        """That of hovering at the way-point."""
        return super().share(ops, self._from_guide(ops, q), v, squares)

    def at_goal(self, ops: Ops, q: Components, v: Components) -> Component:
        """At the way-point and level, or in the first half of the time for it."""
        return super().at_goal(ops, self._from_guide(ops, q), v) | (ops.sin(4.0 * q[5]) > 0.0)

    def draw_start(self, rng: Any, start: str, options: Mapping[str, Any]) -> Components:
        """As for hovering, at any time of any way-point."""
        thrown = super().draw_start(rng, start, options)
        return *thrown, rng.uniform(low=-pi, high=pi), 0.5 * pi / self.way_point_period

    def _from_guide(self, ops: Ops, q: Components) -> Components:
        x, z = self.target(ops, q)
        return q[0] - x, q[1] - z, *q[2:]
