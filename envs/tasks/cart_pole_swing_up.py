"""Swing the pole of a cart-pole up on a bounded track and keep it there."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import inf, pi
from typing import Any, ClassVar

from integ_gym.support.parameters import parameter, positive

from ..ops.ops import Component, Components, Ops
from .interface import BoxTask, uniform
from .pendulum_swing_up import NEAR_UPRIGHT, wrapped

REWARD_STEP = 0.02
"""Time that earns at most 1, s: the rate of ``CartPole-v1``."""


@dataclass(frozen=True)
class CartPoleSwingUp(BoxTask):
    """Reward rate up to 1 / 0.02 s, the more the higher the pole, the nearer to the middle and the
    smaller the force."""

    max_force: float = parameter(10.0, "N", "force limit of the motor", positive)
    track_limit: float = parameter(2.4, "m", "stops at ±`track_limit`", positive)

    plant: ClassVar[str] = "cart_pole"
    starts: ClassVar[tuple[str, ...]] = ("hanging", "upright")
    start_options: ClassVar[tuple[str, ...]] = ("low", "high")
    goal: ClassVar[str] = (
        "|theta| < 0.2 rad (wrapped) throughout the last 2 s, cart within the track"
    )
    goal_stay: ClassVar[float] = 2.0
    goal_edge: ClassVar[tuple[float, ...]] = (0.0, NEAR_UPRIGHT)
    observation_names: ClassVar[tuple[str, ...]] = (
        "x", "x_dot", "cos_theta", "sin_theta", "theta_dot",
    )  # fmt: skip
    observation_units: ClassVar[tuple[str, ...]] = ("m", "m/s", "1", "1", "rad/s")

    @property
    def control_limit(self) -> Component:
        """Force limit, N."""
        return self.max_force

    def observation_limits(self, max_speed: float | None) -> tuple[float, ...]:
        """Infinity for x, as the stops give way; 1 and 1; the speed limit or infinity."""
        speed = inf if max_speed is None else max_speed
        return inf, speed, 1.0, 1.0, speed

    def observe(self, ops: Ops, q: Components, v: Components) -> Components:
        """(x, ẋ, cos θ, sin θ, θ̇)."""
        return q[0], v[0], ops.cos(q[1]), ops.sin(q[1]), v[1]

    def reward(
        self,
        ops: Ops,
        q: Components,
        v: Components,
        mean_square_control: Component,
        terminated: Component,
        control_period: float,
    ) -> Component:
        """Product of height and centring at the start of the period and gentleness in it."""
        height = 0.5 * (1.0 + ops.cos(q[1]))
        away = ops.minimum(abs(q[0]) / self.track_limit, 1.0)
        effort = mean_square_control / (self.max_force * self.max_force)
        share = height * (1.0 - 0.5 * away * away) * (1.0 - 0.1 * effort)
        return share * (control_period / REWARD_STEP)

    def at_goal(self, ops: Ops, q: Components, v: Components) -> Component:
        """Near upright, with the cart within the track."""
        return (abs(wrapped(ops, q[1])) < NEAR_UPRIGHT) & (abs(q[0]) <= self.track_limit)

    def draw_start(self, rng: Any, start: str, options: Mapping[str, Any]) -> Components:
        """Every component uniform in [low, high], by default ±0.05, around rest ``start``."""
        x, x_dot, theta, theta_dot = uniform(rng, options, 4, 0.05)
        return x, x_dot, theta + (pi if start == "hanging" else 0.0), theta_dot
