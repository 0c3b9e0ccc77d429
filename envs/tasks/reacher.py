"""Following a moving marker with the tip of a two-joint arm."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import inf, pi
from typing import Any, ClassVar

from integ_gym.support.parameters import parameter, positive

from ..ops.ops import Component, Components, Ops
from .acrobot import LINK_NAMES, LINK_UNITS, observe_links
from .interface import BoxTask, Limits

MARKER_CENTRE, MARKER_RADIUS = (0.0, -0.6), 0.25
"""Of the circle on which the marker goes round, m, seen from the first joint."""

NEAR_MARKER = 0.05
"""Goal: distance of the tip from the marker below this, m."""

FOLLOW_REACH = 0.1
"""Distance at which half the reward of a tip at the marker is left, m."""

Point = tuple[Component, Component]


@dataclass(frozen=True)
class ReacherFollow(BoxTask):
    """Follow a marker that goes round in a circle with the tip of a two-joint arm.

    Reward rate up to 1 / 0.02 s, the more the nearer the tip is to the marker.
    """

    max_torque: float = parameter(10.0, "N m", "limit of the torque at either joint", positive)
    marker_period: float = parameter(2.0, "s", "of the fastest marker's way round", positive)
    length_1: float = parameter(0.5, "m", "first joint to second joint", positive)
    length_2: float = parameter(0.5, "m", "second joint to the tip", positive)

    plant: ClassVar[str] = "reacher"
    takes_targets: ClassVar[bool] = True
    starts: ClassVar[tuple[str, ...]] = ("bent",)
    start_options: ClassVar[tuple[str, ...]] = ()
    goal: ClassVar[str] = "tip within 0.05 m of the marker throughout the last 2 s"
    goal_stay: ClassVar[float] = 2.0
    near_target: ClassVar[float] = NEAR_MARKER
    observation_names: ClassVar[tuple[str, ...]] = (
        *LINK_NAMES, "marker_x", "marker_z", "marker_x_dot", "marker_z_dot",
    )  # fmt: skip
    observation_units: ClassVar[tuple[str, ...]] = (*LINK_UNITS, "m", "m", "m/s", "m/s")

    @property
    def control_limits(self) -> Limits:
        """±`max_torque` at both joints, N m."""
        return ((-self.max_torque, self.max_torque),) * 2

    def observation_limits(self, max_speed: float | None) -> tuple[float, ...]:
        """1 four times, twice the speed limit or infinity, and infinity for the marker's."""
        speed = inf if max_speed is None else max_speed
        return 1.0, 1.0, 1.0, 1.0, speed, speed, inf, inf, inf, inf

    def target(self, ops: Ops, q: Components) -> Point:
        """Where the marker is, (x, z) in m."""
        along, up = self._from_centre(ops, q)
        return MARKER_CENTRE[0] + along, MARKER_CENTRE[1] + up

    def tip(self, ops: Ops, q: Components) -> Point:
        """Where the tip is, (x, z) in m."""
        first, second = q[0], q[0] + q[1]
        return (
            self.length_1 * ops.sin(first) + self.length_2 * ops.sin(second),
            -self.length_1 * ops.cos(first) - self.length_2 * ops.cos(second),
        )

    def observe(self, ops: Ops, q: Components, v: Components) -> Components:
        """(cos θ₁, sin θ₁, cos θ₂, sin θ₂, θ̇₁, θ̇₂), and the marker's (x, z, ẋ, ż)."""
        along, up = self._from_centre(ops, q)
        return *observe_links(ops, q, v), *self.target(ops, q), -up * v[2], along * v[2]

    def share(self, ops: Ops, q: Components, v: Components, squares: Components) -> Component:
        """Nearness to the marker at the start of the period times gentleness in it."""
        full = self.max_torque * self.max_torque
        effort = 0.5 * (squares[0] + squares[1]) / full
        away = self._squared_distance(ops, q) / (FOLLOW_REACH * FOLLOW_REACH)
        return (1.0 - 0.1 * effort) / (1.0 + away)

    def at_goal(self, ops: Ops, q: Components, v: Components) -> Component:
        """The tip at the marker."""
        return self._squared_distance(ops, q) < NEAR_MARKER * NEAR_MARKER

    def draw_start(self, rng: Any, start: str, options: Mapping[str, Any]) -> Components:
        """θ₁ in ±0.5 rad and θ₂ from 0.5 to 2 rad, at rest; the marker anywhere, at any rate."""
        low, high = [-0.5, 0.5, -pi, -1.0], [0.5, 2.0, pi, 1.0]
        theta_1, theta_2, phase, turn = rng.uniform(low=low, high=high)
        return theta_1, 0.0, theta_2, 0.0, phase, turn * (2.0 * pi / self.marker_period)

    def _from_centre(self, ops: Ops, q: Components) -> Point:
        return MARKER_RADIUS * ops.cos(q[2]), MARKER_RADIUS * ops.sin(q[2])

    def _squared_distance(self, ops: Ops, q: Components) -> Component:
        (x, z), (tip_x, tip_z) = self.target(ops, q), self.tip(ops, q)
        return (x - tip_x) * (x - tip_x) + (z - tip_z) * (z - tip_z)
