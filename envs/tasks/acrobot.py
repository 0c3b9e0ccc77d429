"""Swinging an acrobot's tip up, and holding it upright."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import inf, pi
from typing import Any, ClassVar

from integ_gym.support.parameters import optional, parameter, positive

from ..ops.ops import Component, Components, Ops
from .interface import NEAR_UPRIGHT, BoxTask, Command, Limits, choose, draw_uniform, wrap_angle

ACROBOT_STEP = 0.2
"""Control period of ``Acrobot-v1``, s: the rewards are equal there."""


def observe_links(ops: Ops, q: Components, v: Components) -> Components:
    """(cos θ₁, sin θ₁, cos θ₂, sin θ₂, θ̇₁, θ̇₂)."""
    return ops.cos(q[0]), ops.sin(q[0]), ops.cos(q[1]), ops.sin(q[1]), v[0], v[1]


def round_to_float32(x: Component) -> Component:
    """The nearest number of float32's 24 digits; Veltkamp's splitting, Dekker (1971)."""
    scaled = (2.0**29 + 1.0) * x
    return scaled - (scaled - x)


LINK_NAMES = (
    "cos_theta_1", "sin_theta_1", "cos_theta_2", "sin_theta_2", "theta_1_dot", "theta_2_dot",
)  # fmt: skip
LINK_UNITS = ("1", "1", "1", "1", "rad/s", "rad/s")


@dataclass(frozen=True)
class AcrobotReach:
    """Swing the tip of an acrobot a link's length above its first joint, and end there.

    Reward rate -1 / 0.2 s until then, as in ``Acrobot-v1``.
    """

    torque: float = parameter(1.0, "N m", "magnitude of the torque", positive)
    max_speed_1: float | None = parameter(
        None, "rad/s", "clip on the first joint's speed; `None`: no clip", optional(positive)
    )
    max_speed_2: float | None = parameter(
        None, "rad/s", "clip on the second joint's speed; `None`: no clip", optional(positive)
    )

    plant: ClassVar[str] = "acrobot"
    starts: ClassVar[tuple[str, ...]] = ("hanging",)
    start_options: ClassVar[tuple[str, ...]] = ("low", "high")
    discrete: ClassVar[int | None] = 3
    goal: ClassVar[str] = (
        "-cos(theta_1) - cos(theta_1 + theta_2) > 1 at the end of a control period"
    )
    goal_stay: ClassVar[float] = 0.0
    ends_at_goal: ClassVar[bool] = True
    positions_first: ClassVar[bool] = True
    observation_names: ClassVar[tuple[str, ...]] = LINK_NAMES
    observation_units: ClassVar[tuple[str, ...]] = LINK_UNITS

    @property
    def control_limits(self) -> Limits:
        """±`torque`, N m."""
        return ((-self.torque, self.torque),)

    def observation_limits(self, max_speed: float | None) -> tuple[float, ...]:
        """1 four times, and the speed limits or infinity."""
        own = (self.max_speed_1, self.max_speed_2)
        limits = [most if max_speed is None else max_speed for most in own]
        return (1.0, 1.0, 1.0, 1.0, *[inf if most is None else most for most in limits])

    def command(self, ops: Ops, action: Components) -> Command:
        """Actions 0, 1 and 2 turn the second link with -`torque`, 0 and `torque`."""
        return choose(ops, action, lambda choice: (choice - 1.0) * self.torque)

    def observe(self, ops: Ops, q: Components, v: Components) -> Components:
        """(cos θ₁, sin θ₁, cos θ₂, sin θ₂, θ̇₁, θ̇₂)."""
        return observe_links(ops, q, v)

    def reward(
        self,
        ops: Ops,
        q: Components,
        v: Components,
        mean_squares: Components,
        terminated: Component,
        control_period: float,
    ) -> Component:
        """Minus one per 0.2 s, but nothing in the control period that ends at the goal."""
        return ops.where(terminated, 0.0, -control_period / ACROBOT_STEP)

    def worst_return(
        self, ops: Ops, remaining: Component, control_period: float, top_speed: Component
    ) -> Component:
        """Never at the goal in all that remains."""
        return -(control_period / ACROBOT_STEP) * remaining

    def terminated(self, ops: Ops, q: Components, v: Components) -> Component:
        """At the goal."""
        return self.at_goal(ops, q, v)

    def at_goal(self, ops: Ops, q: Components, v: Components) -> Component:
        """Tip high enough, by the angles; with links of 1 m its height above the joint is 1 m."""
        return -ops.cos(q[0]) - ops.cos(q[0] + q[1]) > 1.0

    def draw_start(self, rng: Any, start: str, options: Mapping[str, Any]) -> Components:
        """Every component uniform in [low, high], by default ±0.1, as Gymnasium draws them."""
        drawn = draw_uniform(rng, options, 4, 0.1)
        theta_1, theta_2, theta_1_dot, theta_2_dot = map(round_to_float32, drawn)
        return theta_1, theta_1_dot, theta_2, theta_2_dot


@dataclass(frozen=True)
class AcrobotSwingUp(BoxTask):
    """Swing a torque-limited acrobot up and keep it there.

    Reward rate up to 1 / 0.02 s, the more the higher both links point and the smaller the torque.
    """

    max_torque: float = parameter(20.0, "N m", "torque limit of the motor", positive)

    plant: ClassVar[str] = "acrobot"
    starts: ClassVar[tuple[str, ...]] = ("hanging",)
    start_options: ClassVar[tuple[str, ...]] = ("low", "high")
    goal: ClassVar[str] = (
        "|theta_1 - pi| < 0.2 rad and |theta_2| < 0.2 rad (wrapped) throughout the last 2 s"
    )
    goal_stay: ClassVar[float] = 2.0
    goal_edge: ClassVar[tuple[float, ...]] = (pi - NEAR_UPRIGHT, -NEAR_UPRIGHT)
    positions_first: ClassVar[bool] = True
    observation_names: ClassVar[tuple[str, ...]] = LINK_NAMES
    observation_units: ClassVar[tuple[str, ...]] = LINK_UNITS

    @property
    def control_limit(self) -> Component:
        """Torque limit, N m."""
        return self.max_torque

    def observation_limits(self, max_speed: float | None) -> tuple[float, ...]:
        """1 four times, and the speed limit or infinity."""
        speed = inf if max_speed is None else max_speed
        return 1.0, 1.0, 1.0, 1.0, speed, speed

    def observe(self, ops: Ops, q: Components, v: Components) -> Components:
        """(cos θ₁, sin θ₁, cos θ₂, sin θ₂, θ̇₁, θ̇₂)."""
        return observe_links(ops, q, v)

    def share(self, ops: Ops, q: Components, v: Components, squares: Components) -> Component:
        """Product of both links' heights at the start of the period and gentleness in it."""
        height = 0.25 * (1.0 - ops.cos(q[0])) * (1.0 - ops.cos(q[0] + q[1]))
        effort = squares[0] / (self.max_torque * self.max_torque)
        return height * (1.0 - 0.1 * effort)

    def at_goal(self, ops: Ops, q: Components, v: Components) -> Component:
        """Both links near upright."""
        straight = abs(wrap_angle(ops, q[1])) < NEAR_UPRIGHT
        return (abs(wrap_angle(ops, q[0] + pi)) < NEAR_UPRIGHT) & straight

    def draw_start(self, rng: Any, start: str, options: Mapping[str, Any]) -> Components:
        """Every component uniform in [low, high], by default ±0.1, around rest hanging."""
        return draw_uniform(rng, options, 4, 0.1)
