"""The interface of tasks, and what they share."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import reduce
from math import isfinite, pi
from operator import and_, or_
from typing import Any, ClassVar, NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from integ_gym.support.errors import InputError

from ..ops.ops import Array, Component, Components, Ops


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
    """A task is a frozen dataclass whose fields are its parameters.

    Where a class attribute ``positions_first`` is true, ``env.unwrapped.state`` and the reset
    option ``state`` are (q0, q1, …, v0, v1, …), and without it in state order (q0, v0, q1, v1, …).
    """

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
    What moves by itself, for pictures to show: a method ``target(ops, q)`` gives its place in m,
    and a class attribute ``near_target`` the distance from it that counts as there, m.
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


def to_public_order(task: Any, state: Array) -> Array:
    """States in the order of ``env.unwrapped.state``.

    Args:
        task: whose ``positions_first`` says the order; state order without it.
        state: in state order, array of shape (…, n).
    """
    return state[..., _public_places(state.shape[-1])] if _positions_first(task) else state


def to_state_order(task: Any, state: Any) -> Any:
    """The inverse of :func:`to_public_order`."""
    if not _positions_first(task):
        return state
    return state[..., np.argsort(_public_places(state.shape[-1]))]


def _positions_first(task: Any) -> bool:
    return bool(getattr(task, "positions_first", False))


def _public_places(size: int) -> npt.NDArray[np.int64]:
    """Where the entries of (q0, q1, …, v0, v1, …) are in state order."""
    return np.arange(size).reshape(-1, 2).T.ravel()


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


def choose(ops: Ops, action: Components, control_of: Callable[[Component], Component]) -> Command:
    """The control that a choice of a `Discrete` action space asks for."""
    (choice,) = action
    valid = ops.assume_true(ops.isfinite(choice))
    return Command((ops.where(valid, control_of(choice), 0.0),), valid, valid & False)


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

    def reward(
        self,
        ops: Ops,
        q: Components,
        v: Components,
        mean_squares: Components,
        terminated: Component,
        control_period: float,
    ) -> Component:
        """Up to 1 per 0.02 s."""
        return self.share(ops, q, v, mean_squares) * (control_period / REWARD_STEP)

    def share(self, ops: Ops, q: Components, v: Components, squares: Components) -> Component:
        """Of that reward, what a control period that began in (q, v) pays, from 0 to 1."""
        raise NotImplementedError

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


REWARD_STEP = 0.02
"""Time in which the other tasks pay at most 1, s: the rate of ``CartPole-v1``."""

NEAR_UPRIGHT = 0.2
"""Goal: |wrapped θ| below this, rad."""

SWING_TIME = 0.3
"""Time by which a speed counts like a distance in the reward, s."""


def wrap_angle(ops: Ops, angle: Component) -> Component:
    """Angle in [-π, π)."""
    return angle - 2.0 * pi * ops.floor((angle + pi) * (0.5 / pi))
