"""`info`: what is told about every reset and step, with the solver's status as a code."""

from __future__ import annotations

from typing import Any

from .control_period import AWAY, OK, EnvState, Outcome
from .settings import Setup


def reset_info(state: EnvState, status: int = OK) -> dict[str, Any]:
    """`info` of a reset: the keys of a step, nothing booked."""
    return {
        "time": 0.0,
        "energy": state.energy,
        "actuator_work": 0.0,
        "dissipated": 0.0,
        "contact_loss": 0.0,
        "clip_loss": 0.0,
        "energy_residual": 0.0,
        "control": 0.0,
        "commanded": 0.0,
        "saturated": False,
        "fallback_used": False,
        "sensor_time": 0.0,
        "penetration": 0.0,
        "contact_force": 0.0,
        "goal_since": state.goal_since,
        "success": False,
        "solver_iterations": 0,
        "solver_residual": 0.0,
        "solver_status": status,
    }


BLANK = reset_info(EnvState((), (), 0.0, (), (), (), (), 0.0, 0, AWAY))
"""What is told about a reset, but for what depends on the start."""


def step_info(setup: Setup, state: EnvState, outcome: Outcome) -> dict[str, Any]:
    """`info` of a step, in the order of :func:`reset_info`."""
    return {
        "time": state.steps * setup.timing.control_period,
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
