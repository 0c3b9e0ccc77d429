"""The step of an environment in JavaScript, for a page that simulates in its reader's browser."""

from __future__ import annotations

from functools import partial
from typing import Any, NamedTuple

from ..arithmetic.ops import (
    SCALAR,
    Component,
    Components,
    Ops,
)
from ..arithmetic.tracing.compiling import source_of
from ..arithmetic.tracing.dialects import JAVASCRIPT
from .control_period import EnvState, initial_state, transition
from .settings import Setup
from .steps import truths


class Script(NamedTuple):
    """Source of two arrow functions; tuples are arrays."""

    start: str
    """(q, v) to [state, observation]."""
    step: str
    """(state, action) to [state, observation, told], or null where the motion diverges or the
    action is not finite. `told` has `control` in force at the end, N or N m, what `motor`,
    `numerics` and `losses` gave and took in the period, J, and `ended` and `success`."""


def script_of(setup: Setup) -> Script | None:
    """The start and the step of a setup, written down from the one definition of its physics.

    Returns:
        None where they cannot be: where an engine calls what is not of our own arithmetic, a part
        needs to know the value of a component, or observations are noisy.
    """
    if setup.settings.observation_noise:
        return None
    rest = (0.0,) * len(setup.plant.coordinates)
    try:
        state = tuple(initial_state(SCALAR, setup, rest, rest))
        return Script(
            source_of(JAVASCRIPT, partial(_start, setup), truths(rest), truths(rest)),
            source_of(JAVASCRIPT, partial(_step, setup), truths(state), False),
        )
    except Exception:  # whatever a part of the user's own does with what is not a float
        return None


def _start(setup: Setup, ops: Ops, q: Components, v: Components) -> tuple[Any, ...]:
    state = initial_state(ops, setup, q, v)
    return tuple(state), setup.task.observe(ops, state.q, state.v)


def _step(setup: Setup, ops: Ops, state: tuple[Any, ...], action: Component) -> tuple[Any, ...]:
    after, outcome = transition(ops, setup, EnvState._make(state), action)
    told = {
        "control": outcome.control,
        "motor": outcome.work,
        "numerics": outcome.residual_energy,
        "losses": outcome.dissipated + outcome.contact_loss + outcome.clip_loss,
        "ended": outcome.terminated | outcome.truncated,
        "success": outcome.success,
    }
    return tuple(after), setup.task.observe(ops, after.sensed_q, after.sensed_v), told
