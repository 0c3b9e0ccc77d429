"""Tasks: what is asked of a plant. A task knows no integrator, engine or environment."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import reduce
from math import inf, isfinite, pi
from operator import and_, or_
from typing import Any, ClassVar, NamedTuple, Protocol

from integ_gym.support.errors import InputError
from integ_gym.support.parameters import boolean, parameter, positive

from .ops.ops import Component, Components, Ops


class Command(NamedTuple):
    """An action turned into a control."""

    controls: Components
    """Each within its actuator's limits; 0 where the action is not valid."""
    valid: Component
    """False for an action that is not finite, on which the fallback acts."""
    saturated: Component
    """Whether some control is at a limit."""


Limits = tuple[tuple[Component, Component], ...]
"""(smallest, largest) value of each control."""


class Task(Protocol):
    """A task is a frozen dataclass whose fields are its parameters."""

    plant: ClassVar[str]
    starts: ClassVar[tuple[str, ...]]
    """Names of the start distributions, the default first."""
    start_options: ClassVar[tuple[str, ...]]
    """Reset options that :meth:`draw_start` reads."""
    discrete: ClassVar[int | None]
    """Number of actions of a `Discrete` action space, or None for a `Box`."""
    goal: ClassVar[str]
    """Success in words, with numbers and units."""
    goal_stay: ClassVar[float]
    """How long the goal must have held, without a break, when the episode ends, s.

    Where a class attribute ``ends_at_goal`` is true, it is the goal that terminates the episode.
    """
    observation_names: ClassVar[tuple[str, ...]]
    observation_units: ClassVar[tuple[str, ...]]

    @property
    def control_limits(self) -> Limits:
        """Smallest and largest value of each control, with 0 between them, in its unit."""

    def observation_limits(self, max_speed: float | None) -> tuple[float, ...]:
        """Largest magnitude of each observation."""

    def command(self, ops: Ops, action: Components) -> Command:
        """The controls that an action asks for: entries of a `Box`, or the one of a `Discrete`."""

    def observe(self, ops: Ops, q: Components, v: Components) -> Components:
        """Observation of a sensed state."""

    def reward(
        self,
        ops: Ops,
        q: Components,
        v: Components,
        mean_squares: Components,
        terminated: Component,
        control_period: float,
    ) -> Component:
        """Reward of one control period that began in (q, v), by each control's mean square."""

    def worst_return(
        self, ops: Ops, remaining: Component, control_period: float, top_speed: Component
    ) -> Component:
        """Lower bound on the return of the ``remaining`` decisions, given to a divergence."""

    def terminated(self, ops: Ops, q: Components, v: Components) -> Component:
        """Whether the state ends the episode."""

    def at_goal(self, ops: Ops, q: Components, v: Components) -> Component:
        """Whether the state is where the task wants it."""

    def draw_start(self, rng: Any, start: str, options: Mapping[str, Any]) -> Components:
        """A start in state order, drawn with a ``numpy.random.Generator``.

        Where it is made of ``rng.uniform`` alone and calls no ``float``, the starts of many lanes
        are made at once, from the same numbers.
        """


FLOAT32_ROUNDING = 1e-6
"""Actions arrive in float32, in which the bounds are rounded too."""


def saturate(ops: Ops, action: Components, limits: Limits) -> Command:
    """``action`` within limits; one at a limit counts, as policies clip to it in float32."""
    pairs = list(zip(action, limits, strict=True))
    finite = [ops.isfinite(value) for value in action]
    at_limits = [_is_at_limit(value, *ends) for value, ends in pairs]
    valid = ops.assume_true(reduce(and_, finite))
    within = [ops.maximum(low, ops.minimum(value, high)) for value, (low, high) in pairs]
    controls = tuple([ops.where(valid, value, 0.0) for value in within])
    return Command(controls, valid, valid & reduce(or_, at_limits))


def _is_at_limit(value: Component, low: Component, high: Component) -> Component:
    share = 1.0 - FLOAT32_ROUNDING
    if isinstance(high, float) and low == -high:  # one comparison in place of two
        return abs(value) >= high * share
    return (value <= low * share) | (value >= high * share)


class BoxTask:
    """Controls within limits, no end but by time, and no reward below 0.

    Attributes:
        control_limit: largest magnitude of the control, N m or N, where there is one and its limits
            are symmetric.
    """

    discrete: ClassVar[int | None] = None
    control_limit: Any

    @property
    def control_limits(self) -> Limits:
        """±``control_limit``."""
        return ((-self.control_limit, self.control_limit),)

    def command(self, ops: Ops, action: Components) -> Command:
        """The controls, saturated."""
        return saturate(ops, action, self.control_limits)

    def worst_return(
        self, ops: Ops, remaining: Component, control_period: float, top_speed: Component
    ) -> Component:
        """No further reward."""
        return 0.0 * remaining

    def terminated(self, ops: Ops, q: Components, v: Components) -> Component:
        """Never."""
        return False


def read_number(options: Mapping[str, Any], name: str, default: float) -> float:
    """Option ``name`` as a float.

    Raises:
        ValueError: if it is not a number.
    """
    value = options.get(name, default)
    try:
        return float(value)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"reset option `{name}` must be a number, got {value!r:.60}") from error


def draw_uniform(rng: Any, options: Mapping[str, Any], size: int, half_width: float) -> Components:
    """``size`` numbers uniform between the options ``low`` and ``high``.

    Args:
        rng: a ``numpy.random.Generator``, or what stands for it.
        options: reset options; without bounds ±``half_width``.

    Raises:
        ValueError: if the bounds are not finite and in order.
    """
    low, high = read_number(options, "low", -half_width), read_number(options, "high", half_width)
    if not (isfinite(high - low) and low <= high):
        raise InputError(f"reset option `low`={low} must be finite and at most `high`={high}")
    return tuple(rng.uniform(low=low, high=high, size=(size,)))


PENDULUM_STEP = 0.05
"""Control period of ``Pendulum-v1``, s: the rewards are equal there."""

REWARD_STEP = 0.02
"""Time in which the other tasks pay at most 1, s: the rate of ``CartPole-v1``."""

NEAR_UPRIGHT = 0.2
"""Goal: |wrapped θ| below this, rad."""


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


def wrap_angle(ops: Ops, angle: Component) -> Component:
    """Angle in [-π, π)."""
    return angle - 2.0 * pi * ops.floor((angle + pi) * (0.5 / pi))


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
        (choice,) = action
        valid = ops.assume_true(ops.isfinite(choice))
        force = ops.where(choice == 1, self.force_mag, -self.force_mag)
        return Command((ops.where(valid, force, 0.0),), valid, valid & False)

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

    def reward(
        self,
        ops: Ops,
        q: Components,
        v: Components,
        mean_squares: Components,
        terminated: Component,
        control_period: float,
    ) -> Component:
        """Product of height and centring at the start of the period and gentleness in it."""
        height = 0.5 * (1.0 + ops.cos(q[1]))
        away = ops.minimum(abs(q[0]) / self.track_limit, 1.0)
        effort = mean_squares[0] / (self.max_force * self.max_force)
        share = height * (1.0 - 0.5 * away * away) * (1.0 - 0.1 * effort)
        return share * (control_period / REWARD_STEP)

    def at_goal(self, ops: Ops, q: Components, v: Components) -> Component:
        """Near upright, with the cart within the track."""
        return (abs(wrap_angle(ops, q[1])) < NEAR_UPRIGHT) & (abs(q[0]) <= self.track_limit)

    def draw_start(self, rng: Any, start: str, options: Mapping[str, Any]) -> Components:
        """Every component uniform in [low, high], by default ±0.05, around rest ``start``."""
        x, x_dot, theta, theta_dot = draw_uniform(rng, options, 4, 0.05)
        return x, x_dot, theta + (pi if start == "hanging" else 0.0), theta_dot


NEAR_PLUMB = 0.1
"""Goal: |x| below this, m."""

SWING_TIME = 0.3
"""Time by which a speed counts like a distance in the reward, s."""


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

    def reward(
        self,
        ops: Ops,
        q: Components,
        v: Components,
        mean_squares: Components,
        terminated: Component,
        control_period: float,
    ) -> Component:
        """Nearness to rest at the start of the period times gentleness in it."""
        away, speed = q[0] / NEAR_PLUMB, SWING_TIME * v[0] / NEAR_PLUMB
        effort = mean_squares[0] / (self.max_force * self.max_force)
        share = (1.0 - 0.1 * effort) / (1.0 + away * away + speed * speed)
        return share * (control_period / REWARD_STEP)

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


ROOM = 3.0
"""Half the width and height of the room that a quadrotor must not leave, m."""

NEAR_TARGET = 0.1
"""Goal: distance from the target below this, m."""

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

    def reward(
        self,
        ops: Ops,
        q: Components,
        v: Components,
        mean_squares: Components,
        terminated: Component,
        control_period: float,
    ) -> Component:
        """Nearness to level rest at the start of the period times gentleness in it."""
        speed_weight = SWING_TIME * SWING_TIME
        away = q[0] * q[0] + q[1] * q[1] + speed_weight * (v[0] * v[0] + v[1] * v[1])
        tilt = 2.0 * (1.0 - ops.cos(q[2])) + speed_weight * v[2] * v[2]
        full = self.max_thrust * self.max_thrust
        effort = 0.5 * (mean_squares[0] + mean_squares[1]) / full
        share = (1.0 - 0.1 * effort) / (1.0 + away / (HOVER_REACH * HOVER_REACH) + tilt)
        return share * (control_period / REWARD_STEP)

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
