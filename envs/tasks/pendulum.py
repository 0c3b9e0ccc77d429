"""Swinging a pendulum up."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import inf, isfinite, pi
from typing import Any, ClassVar

from integ_gym.support.errors import InputError
from integ_gym.support.parameters import parameter, positive

from ..ops.ops import Component, Components, Ops
from .interface import (
    NEAR_UPRIGHT,
    BoxTask,
    read_number,
    wrap_angle,
)

PENDULUM_STEP = 0.05
"""Control period of ``Pendulum-v1``, s: the rewards are equal there."""


@dataclass(frozen=True)
class PendulumSwingUp(BoxTask):
    """Swing a torque-limited pendulum up and keep it there.

    Reward rate -(θ² + 0.1 θ̇² + 0.001 τ²) / 0.05 s with θ wrapped, as in ``Pendulum-v1``.
    """

    max_torque: float = parameter(2.0, "N m", "torque limit of the motor", positive)

    plant: ClassVar[str] = "pendulum"
    starts: ClassVar[tuple[str, ...]] = ("uniform", "hanging")
    start_options: ClassVar[tuple[str, ...]] = ("x_init", "y_init")
    goal: ClassVar[str] = "|theta| < 0.2 rad (wrapped) throughout the last 2 s"
    goal_stay: ClassVar[float] = 2.0
    goal_edge: ClassVar[tuple[float, ...]] = (NEAR_UPRIGHT,)
    observation_names: ClassVar[tuple[str, ...]] = ("cos_theta", "sin_theta", "theta_dot")
    observation_units: ClassVar[tuple[str, ...]] = ("1", "1", "rad/s")

    @property
    def control_limit(self) -> Component:
        """Torque limit, N m."""
        return self.max_torque

    def observation_limits(self, max_speed: float | None) -> tuple[float, ...]:
        """(1, 1, speed limit or infinity)."""
        return 1.0, 1.0, inf if max_speed is None else max_speed

    def observe(self, ops: Ops, q: Components, v: Components) -> Components:
        """(cos θ, sin θ, θ̇)."""
        return ops.cos(q[0]), ops.sin(q[0]), v[0]

    def reward(
        self,
        ops: Ops,
        q: Components,
        v: Components,
        mean_squares: Components,
        terminated: Component,
        control_period: float,
    ) -> Component:
        """Quadratic cost of the state at the start of the period, and of the control in it."""
        angle = wrap_angle(ops, q[0])
        cost = angle * angle + 0.1 * (v[0] * v[0]) + 0.001 * mean_squares[0]
        return -cost * (control_period / PENDULUM_STEP)

    def worst_return(
        self, ops: Ops, remaining: Component, control_period: float, top_speed: Component
    ) -> Component:
        """Hanging at top speed under full torque for all that remains."""
        limit = self.max_torque
        cost = pi * pi + 0.1 * (top_speed * top_speed) + 0.001 * (limit * limit)
        return -cost * (control_period / PENDULUM_STEP) * remaining

    def at_goal(self, ops: Ops, q: Components, v: Components) -> Component:
        """Near upright."""
        return abs(wrap_angle(ops, q[0])) < NEAR_UPRIGHT

    def draw_start(self, rng: Any, start: str, options: Mapping[str, Any]) -> Components:
        """Uniform in ±x_init, ±y_init around upright (``uniform``) or the bottom (``hanging``)."""
        centre, x_default, y_default = (0.0, pi, 1.0) if start == "uniform" else (pi, 0.2, 0.2)
        x = read_number(options, "x_init", x_default)
        y = read_number(options, "y_init", y_default)
        if not (isfinite(2.0 * x) and isfinite(2.0 * y) and x >= 0.0 and y >= 0.0):
            raise InputError(
                f"reset options `x_init` and `y_init` must be finite and 0 or above, got {x}, {y}"
            )
        theta, theta_dot = rng.uniform(low=[-x, -y], high=[x, y])
        return centre + theta, theta_dot
