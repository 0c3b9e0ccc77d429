"""The step of a single environment: as it is written, and as one straight-line function."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache, partial
from typing import Any

from integ_gym.envs.info import step_info
from integ_gym.envs.ops import SCALAR, Component, Ops
from integ_gym.envs.settings import Setup
from integ_gym.envs.tracing import compiled
from integ_gym.envs.transition import EnvState, initial_state, transition

ScalarStep = Callable[[EnvState, float], tuple[Any, ...]]
"""(state, action) to (state, observation, reward, terminated, truncated, info, sampled)."""

_KEPT = 64
"""Traced steps kept, for environments that are made again."""


def plain_step(setup: Setup) -> ScalarStep:
    """The step of a setup, as it is written."""
    return partial(_step, setup, SCALAR)


def traced_step(setup: Setup) -> ScalarStep | None:
    """The same step as one function without calls, several times as fast, to the same bits.

    It raises ``ArithmeticError`` or ``ValueError`` where a motion leaves the domain of the scalar
    arithmetic; the plain step says what follows then.

    Returns:
        None where a part cannot be traced, such as a user's integrator that asks ``if x > 0.0``.
    """
    return _traced(_Key(setup))


def _step(setup: Setup, ops: Ops, state: tuple[Any, ...], action: Component) -> tuple[Any, ...]:
    after, outcome = transition(ops, setup, EnvState._make(state), action)
    return (
        tuple(after),
        setup.task.observe(ops, after.sensed_q, after.sensed_v),
        outcome.reward,
        outcome.terminated,
        outcome.truncated,
        step_info(ops, setup, after, outcome),
        outcome.sampled,
    )


class _Key:
    """A setup that equals others made of the same classes and arguments.

    One with an engine that keeps a simulator's data of its own equals itself alone.
    """

    def __init__(self, setup: Setup) -> None:
        self.setup = setup
        parts = (setup.plant, setup.task, setup.engine, getattr(setup.engine, "integrator", None))
        own = None if setup.engine.batched else id(setup.engine)
        self._parts = (*(type(part) for part in parts), repr(setup.arguments()), own)

    def __hash__(self) -> int:
        return hash(self._parts)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Key) and self._parts == other._parts


@lru_cache(maxsize=_KEPT)
def _traced(key: _Key) -> ScalarStep | None:
    setup = key.setup
    rest = (0.0,) * len(setup.plant.coordinates)
    start = initial_state(SCALAR, setup, rest, rest)
    try:
        return compiled(partial(_step, setup), _truths(tuple(start)), False)
    except Exception:  # whatever a part of the user's own does with what is not a float
        return None


def _truths(value: Any) -> Any:
    """True where a truth value stands, False where a number does."""
    if isinstance(value, tuple):
        return tuple(_truths(part) for part in value)
    return isinstance(value, bool)
