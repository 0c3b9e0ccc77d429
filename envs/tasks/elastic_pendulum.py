"""Bringing an elastic pendulum to rest."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import inf, isfinite
from typing import Any, ClassVar

from integ_gym.support.errors import InputError
from integ_gym.support.parameters import parameter, positive

from ..ops.ops import Component, Components, Ops
from .interface import SWING_TIME, BoxTask, read_number

NEAR_PLUMB = 0.1
"""Goal: |x| below this, m."""


@dataclass(frozen=True)
class ElasticPendulumQuiet(BoxTask):
    """Bring the swinging bob of an elastic pendulum to rest.

    Reward rate up to 1 / 0.02 s, the more the nearer the bob is to rest below its pivot.
    """

    max_force: float = parameter(2.0, "N", "limit of the horizontal force", positive)

    plant: ClassVar[str] = "elastic_pendulum"
    starts: ClassVar[tuple[str, ...]] = ("pushed",)
    start_options: ClassVar[tuple[str, ...]] = ("push",)
    goal: ClassVar[str] = "|x| < 0.1 m throughout the last 2 s"
    goal_stay: ClassVar[float] = 2.0
    observation_names: ClassVar[tuple[str, ...]] = ("x", "x_dot", "y", "y_dot")
    observation_units: ClassVar[tuple[str, ...]] = ("m", "m/s", "m", "m/s")

    @property
    def control_limit(self) -> Component:
        """Force limit, N."""
        return self.max_force

    def observation_limits(self, max_speed: float | None) -> tuple[float, ...]:
        """Infinity for both distances; the speed limit or infinity for both speeds."""
        speed = inf if max_speed is None else max_speed
        return inf, speed, inf, speed

    def observe(self, ops: Ops, q: Components, v: Components) -> Components:
        """(x, ẋ, y, ẏ)."""
        return q[0], v[0], q[1], v[1]

    def share(self, ops: Ops, q: Components, v: Components, squares: Components) -> Component:
        """Nearness to rest at the start of the period times gentleness in it."""
        away, speed = q[0] / NEAR_PLUMB, SWING_TIME * v[0] / NEAR_PLUMB
        effort = squares[0] / (self.max_force * self.max_force)
        return (1.0 - 0.1 * effort) / (1.0 + away * away + speed * speed)

    def at_goal(self, ops: Ops, q: Components, v: Components) -> Component:
        """Near the vertical through the pivot."""
        return abs(q[0]) < NEAR_PLUMB

    def draw_start(self, rng: Any, start: str, options: Mapping[str, Any]) -> Components:
        """At the resting place, with ẋ from push/2 to push and |ẏ| up to push/10, push 3 m/s."""
        push = read_number(options, "push", 3.0)
        if not (isfinite(push) and push >= 0.0):
            raise InputError(f"reset option `push` must be finite and 0 or above, got {push}")
        x_dot, y_dot = rng.uniform(low=[0.5 * push, -0.1 * push], high=[push, 0.1 * push])
        return 0.0, x_dot, 0.0, y_dot
