"""Balancing the pole of a cart-pole, and swinging it up."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import inf, pi
from typing import Any, ClassVar

from integ_gym.support.parameters import boolean, parameter, positive

from ..ops.ops import Component, Components, Ops
from .interface import (
    NEAR_UPRIGHT,
    REWARD_STEP,
    BoxTask,
    Command,
    Limits,
    choose,
    draw_uniform,
    wrap_angle,
)


@dataclass(frozen=True)
class CartPoleBalance:
    """Keep the pole of a cart-pole upright.

    Reward rate 1 / 0.02 s while the pole stands, as in ``CartPole-v1``.
    """

    force_mag: float = parameter(10.0, "N", "magnitude of the force", positive)
    x_threshold: float = parameter(2.4, "m", "the episode ends beyond ±`x_threshold`", positive)
    theta_threshold: float = parameter(
        12 * 2 * pi / 360, "rad", "the episode ends beyond ±`theta_threshold`", positive
    )
    sutton_barto_reward: bool = parameter(
        False, "", "0 per step and −1 at termination instead", boolean
    )

    plant: ClassVar[str] = "cart_pole"
    starts: ClassVar[tuple[str, ...]] = ("upright",)
    start_options: ClassVar[tuple[str, ...]] = ("low", "high")
    discrete: ClassVar[int | None] = 2
    goal: ClassVar[str] = "not terminated within `duration`"
    goal_stay: ClassVar[float] = 0.0
    observation_names: ClassVar[tuple[str, ...]] = ("x", "x_dot", "theta", "theta_dot")
    observation_units: ClassVar[tuple[str, ...]] = ("m", "m/s", "rad", "rad/s")

    @property
    def control_limits(self) -> Limits:
        """±`force_mag`, N."""
        return ((-self.force_mag, self.force_mag),)

    def observation_limits(self, max_speed: float | None) -> tuple[float, ...]:
        """Twice the thresholds, and the speed limit or infinity."""
        speed = inf if max_speed is None else max_speed
        return 2.0 * self.x_threshold, speed, 2.0 * self.theta_threshold, speed

    def command(self, ops: Ops, action: Components) -> Command:
        """Action 0 pushes towards -x, action 1 towards +x."""
        most = self.force_mag
        return choose(ops, action, lambda choice: ops.where(choice == 1, most, -most))

    def observe(self, ops: Ops, q: Components, v: Components) -> Components:
        """(x, ẋ, θ, θ̇), x and θ up to their limits, which a coarse step may pass at the end."""
        far_x, _, far_theta, _ = self.observation_limits(None)
        x = ops.minimum(ops.maximum(q[0], -far_x), far_x)
        theta = ops.minimum(ops.maximum(q[1], -far_theta), far_theta)
        return x, v[0], theta, v[1]

    def reward(
        self,
        ops: Ops,
        q: Components,
        v: Components,
        mean_squares: Components,
        terminated: Component,
        control_period: float,
    ) -> Component:
        """One per 0.02 s, the terminating step included; or Sutton and Barto's -1 at the end."""
        if self.sutton_barto_reward:
            return ops.where(terminated, -1.0, 0.0)
        return control_period / REWARD_STEP + 0.0 * q[0]

    def worst_return(
        self, ops: Ops, remaining: Component, control_period: float, top_speed: Component
    ) -> Component:
        """No further reward, or Sutton and Barto's -1."""
        return (-1.0 if self.sutton_barto_reward else 0.0) + 0.0 * remaining

    def terminated(self, ops: Ops, q: Components, v: Components) -> Component:
        """Beyond a threshold."""
        return self.at_goal(ops, q, v) == False  # noqa: E712

    def at_goal(self, ops: Ops, q: Components, v: Components) -> Component:
        """Within the thresholds."""
        return (abs(q[0]) <= self.x_threshold) & (abs(q[1]) <= self.theta_threshold)

    def draw_start(self, rng: Any, start: str, options: Mapping[str, Any]) -> Components:
        """Every state component uniform in [low, high], by default ±0.05."""
        return draw_uniform(rng, options, 4, 0.05)


@dataclass(frozen=True)
class CartPoleSwingUp(BoxTask):
    """Swing the pole of a cart-pole up on a bounded track and keep it there.

    Reward rate up to 1 / 0.02 s, the more the higher the pole, the nearer to the middle and the
    smaller the force.
    """

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

    def share(self, ops: Ops, q: Components, v: Components, squares: Components) -> Component:
        """Product of height and centring at the start of the period and gentleness in it."""
        height = 0.5 * (1.0 + ops.cos(q[1]))
        away = ops.minimum(abs(q[0]) / self.track_limit, 1.0)
        effort = squares[0] / (self.max_force * self.max_force)
        return height * (1.0 - 0.5 * away * away) * (1.0 - 0.1 * effort)

    def at_goal(self, ops: Ops, q: Components, v: Components) -> Component:
        """Near upright, with the cart within the track."""
        return (abs(wrap_angle(ops, q[1])) < NEAR_UPRIGHT) & (abs(q[0]) <= self.track_limit)

    def draw_start(self, rng: Any, start: str, options: Mapping[str, Any]) -> Components:
        """Every component uniform in [low, high], by default ±0.05, around rest ``start``."""
        x, x_dot, theta, theta_dot = draw_uniform(rng, options, 4, 0.05)
        return x, x_dot, theta + (pi if start == "hanging" else 0.0), theta_dot
