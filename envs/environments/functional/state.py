"""The state of a functional environment, and what a step with automatic reset gives."""

from __future__ import annotations

from typing import Any, NamedTuple

from ...arithmetic import Components
from ...episode import EnvState, Outcome


class FuncState(NamedTuple):
    """State of one environment, or of a batch of them."""

    env: EnvState
    outcome: Outcome
    """What the last transition brought; zeros after a reset."""
    noise: Components
    """Noise of the last sample on each state component, SI; empty without sensor noise."""
    member: Components = ()
    """In a mixture: the member that each lane has drawn, int32; else empty."""


class TimeStep(NamedTuple):
    """What one step with automatic reset gives."""

    observation: Any
    """Of the next episode's start where an episode has ended, float32, shape (*lanes, obs)."""
    reward: Any
    terminated: Any
    truncated: Any
    final_observation: Any
    """Before the reset, float32, shape (*lanes, obs)."""
    info: dict[str, Any]
    """Before the reset; see :meth:`FunctionalEnv.transition_info`."""
