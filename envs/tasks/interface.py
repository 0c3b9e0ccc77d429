"""What a task asks of a plant: start, observation, reward, termination, success."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, NamedTuple, Protocol

from ..arithmetic.ops import Component, Components, Ops


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
