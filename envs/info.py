"""`info` of a single environment: what is told about every reset and step."""

from __future__ import annotations

from typing import Any

from integ_gym.envs.ops import Component, Ops
from integ_gym.envs.settings import Setup
from integ_gym.envs.transition import (
    AWAY,
    DIVERGED,
    NOT_CONVERGED,
    NOT_REPORTED,
    OK,
    STATUS_NAMES,
    EnvState,
    Outcome,
)


def quiet_status(setup: Setup) -> str:
    """Solver status where no step has been taken."""
    return STATUS_NAMES[OK if setup.engine.reports else NOT_REPORTED]


def reset_info(state: EnvState, status: str = STATUS_NAMES[OK]) -> dict[str, Any]:
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


def step_info(ops: Ops, setup: Setup, state: EnvState, outcome: Outcome) -> dict[str, Any]:
    """`info` of a step, in the order of :func:`reset_info`."""
    info = booked(setup, state, outcome)
    info["solver_status"] = _status_name(ops, outcome.status)
    return info


def booked(setup: Setup, state: EnvState, outcome: Outcome) -> dict[str, Any]:
    """`info` of a step without the solver's status."""
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
    }


def _status_name(ops: Ops, status: Component) -> Any:
    bad = ops.where(status == NOT_CONVERGED, STATUS_NAMES[NOT_CONVERGED], STATUS_NAMES[DIVERGED])
    fine = ops.where(status == OK, STATUS_NAMES[OK], STATUS_NAMES[NOT_REPORTED])
    return ops.where(status <= OK, fine, bad)
