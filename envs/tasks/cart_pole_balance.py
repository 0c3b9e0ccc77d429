"""Keep the pole of a cart-pole upright."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import inf, pi
from typing import Any, ClassVar

from integ_gym.support.parameters import boolean, parameter, positive

from ..ops.ops import Component, Components, Ops
from .interface import Command, uniform

GYMNASIUM_STEP = 0.02
"""Control period of ``CartPole-v1``, s: the rewards are equal there."""


@dataclass(frozen=True)
class CartPoleBalance:
    """Reward rate 1 / 0.02 s while the pole stands, as in ``CartPole-v1``."""

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
    def control_limit(self) -> Component:
        """Magnitude of the force, N."""
        return self.force_mag

    def observation_limits(self, max_speed: float | None) -> tuple[float, ...]:
        """Twice the thresholds, and the speed limit or infinity."""
        speed = inf if max_speed is None else max_speed
        return 2.0 * self.x_threshold, speed, 2.0 * self.theta_threshold, speed

    def command(self, ops: Ops, action: Component) -> Command:
        """Action 0 pushes towards -x, action 1 towards +x."""
        valid = ops.usually(ops.isfinite(action))
        force = ops.where(action == 1, self.force_mag, -self.force_mag)
        return Command(ops.where(valid, force, 0.0), valid, valid & False)

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
        mean_square_control: Component,
        terminated: Component,
        control_period: float,
    ) -> Component:
        """One per 0.02 s, the terminating step included; or Sutton and Barto's -1 at the end."""
        if self.sutton_barto_reward:
            return ops.where(terminated, -1.0, 0.0)
        return control_period / GYMNASIUM_STEP + 0.0 * q[0]

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
        return uniform(rng, options, 4, 0.05)
