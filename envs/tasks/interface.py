"""What a task is, and what tasks have in common."""

from __future__ import annotations

from collections.abc import Mapping
from math import isfinite
from typing import Any, ClassVar, NamedTuple, Protocol

from integ_gym.support.errors import InputError

from ..ops.ops import Component, Components, Ops


class Command(NamedTuple):
    """An action turned into a control."""

    control: Component
    """Force or torque within the actuator's limits; 0 where the action is not valid."""
    valid: Component
    """False for a non-finite action, on which the fallback acts."""
    saturated: Component


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
    """How long the goal must have held, without a break, when the episode ends, s."""
    observation_names: ClassVar[tuple[str, ...]]
    observation_units: ClassVar[tuple[str, ...]]

    @property
    def control_limit(self) -> Component:
        """Largest magnitude of the control, N m or N."""

    def observation_limits(self, max_speed: float | None) -> tuple[float, ...]:
        """Largest magnitude of each observation."""

    def command(self, ops: Ops, action: Component) -> Command:
        """The control that an action asks for."""

    def observe(self, ops: Ops, q: Components, v: Components) -> Components:
        """Observation of a sensed state."""

    def reward(
        self,
        ops: Ops,
        q: Components,
        v: Components,
        mean_square_control: Component,
        terminated: Component,
        control_period: float,
    ) -> Component:
        """Reward of one control period that began in (q, v)."""

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


def saturated(ops: Ops, action: Component, limit: Component) -> Command:
    """``action`` within ±``limit``; one at the limit counts, as policies clip to it in float32."""
    valid = ops.usually(ops.isfinite(action))
    clipped = ops.maximum(-limit, ops.minimum(action, limit))
    at_limit = abs(action) >= limit * (1.0 - FLOAT32_ROUNDING)
    return Command(ops.where(valid, clipped, 0.0), valid, valid & at_limit)


class BoxTask:
    """A control within symmetric limits, no end but by time, and no reward below 0."""

    discrete: ClassVar[int | None] = None
    control_limit: Any

    def command(self, ops: Ops, action: Component) -> Command:
        """The control, saturated."""
        return saturated(ops, action, self.control_limit)

    def worst_return(
        self, ops: Ops, remaining: Component, control_period: float, top_speed: Component
    ) -> Component:
        """No further reward."""
        return 0.0 * remaining

    def terminated(self, ops: Ops, q: Components, v: Components) -> Component:
        """Never."""
        return False


def number(options: Mapping[str, Any], name: str, default: float) -> float:
    """Option ``name`` as a float.

    Raises:
        ValueError: if it is not a number.
    """
    value = options.get(name, default)
    try:
        return float(value)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"reset option `{name}` must be a number, got {value!r:.60}") from error


def uniform(rng: Any, options: Mapping[str, Any], size: int, half_width: float) -> Components:
    """``size`` numbers uniform between the options ``low`` and ``high``.

    Args:
        rng: a ``numpy.random.Generator``, or what stands for it.
        options: reset options; without bounds ±``half_width``.

    Raises:
        ValueError: if the bounds are not finite and in order.
    """
    low, high = number(options, "low", -half_width), number(options, "high", half_width)
    if not (isfinite(high - low) and low <= high):
        raise InputError(f"reset option `low`={low} must be finite and at most `high`={high}")
    return tuple(rng.uniform(low=low, high=high, size=(size,)))
