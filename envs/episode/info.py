"""`info`: what is told about every reset and step, with the solver's status as a code."""

from __future__ import annotations

from typing import Any

from ..arithmetic.ops import Component
from .control_period import AWAY, OK, EnvState, Outcome
from .settings import Setup

LOSSES = ("dissipated", "contact_loss", "clip_loss")
"""What is taken out of a plant's energy, by its names."""


def reset_info(state: EnvState, status: int = OK) -> dict[str, Any]:
    """`info` of a reset: the keys of a step, nothing booked."""
    return {**_told(0.0, state, Outcome(status=status)), "sensor_time": 0.0}


def step_info(setup: Setup, state: EnvState, outcome: Outcome) -> dict[str, Any]:
    """`info` of a step."""
    return _told(state.steps * setup.timing.control_period, state, outcome)


def _told(time: Component, state: EnvState, outcome: Outcome) -> dict[str, Any]:
    return {
        "time": time,
        "energy": state.energy,
        "actuator_work": outcome.work,
        "dissipated": outcome.dissipated,
        "contact_loss": outcome.contact_loss,
        "clip_loss": outcome.clip_loss,
        "energy_residual": outcome.residual_energy,
        "control": outcome.control,
        "commanded": outcome.commanded,
        "saturated": outcome.saturated,
        "fallback_used": outcome.fallback_used,
        "sensor_time": state.sensed_time,
        "penetration": outcome.penetration,
        "contact_force": outcome.contact_force,
        "goal_since": state.goal_since,
        "success": outcome.success,
        "solver_iterations": outcome.iterations,
        "solver_residual": outcome.solver_residual,
        "solver_status": outcome.status,
    }


BLANK = reset_info(EnvState((), (), 0.0, (), (), (), (), 0.0, 0, AWAY))
"""What is told about a reset, but for what depends on the start."""
