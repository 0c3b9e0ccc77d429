"""Timestep refinement at a fixed control period: trajectory, energy, task, and cost."""

from __future__ import annotations

import math

import numpy as np

from integ_gym.envs import numerics
from integ_gym.envs.registries import TRUTH

from ..bench import Array as Array
from ..bench import Rollout
from ..experiments import success_lines
from ..lines import Diagnosis, ledger_line, order_line
from .actuation import actuator_limit

_SHARE = 0.5
"""Amplitude of the command in units of the actuator's limit."""


def diagnose_refinement(diagnosis: Diagnosis) -> None:
    """The same commands, and the same controller, at ever smaller steps."""
    subject = diagnosis.subject
    commands = _commands(diagnosis)
    exact = numerics.independent_motion(
        subject.plant, subject.start, commands, subject.control_period
    )
    truth = _driven(diagnosis, TRUTH, commands)
    states = truth[subject.control_period].state[:, 0]
    _draw(diagnosis, TRUTH, truth, exact.states)
    for integrator in diagnosis.integrators:
        rollouts = truth if integrator == TRUTH else _driven(diagnosis, integrator, commands)
        compared = exact.states if integrator == TRUTH else states
        _trajectory(diagnosis, integrator, rollouts, compared)
        ledger_line(diagnosis, integrator, rollouts)
        if integrator != TRUTH:
            _draw(diagnosis, integrator, rollouts, states)
    for env_id in subject.environments:
        cases = [(dt, 0.0) for dt in subject.steps]
        quantity = "success of the hand-made controller"
        success_lines(diagnosis, env_id, quantity, cases[:1], cases, subject.steps)


def _commands(diagnosis: Diagnosis) -> Array:
    """One period of a sine, held over each control period."""
    subject = diagnosis.subject
    count = math.ceil(subject.period / subject.control_period)
    wave: Array = np.sin(2.0 * math.pi * np.arange(count) / count)
    return _SHARE * actuator_limit(subject) * wave


def _driven(diagnosis: Diagnosis, integrator: str, commands: Array) -> dict[float, Rollout]:
    subject = diagnosis.subject
    return diagnosis.follow(
        integrator, diagnosis.ladder(integrator), subject.start, commands, "sine",
        duration=len(commands) * subject.control_period,
    )  # fmt: skip


def _errors(rollouts: dict[float, Rollout], coordinate: int, truth: Array) -> dict[float, float]:
    """Largest error of one coordinate at any control instant, by step; NaN where it diverged."""
    place = 2 * coordinate
    return {
        dt: float(np.abs(r.state[:, 0, place] - truth[:, place]).max())
        for dt, r in rollouts.items()
    }


def _trajectory(
    diagnosis: Diagnosis, integrator: str, rollouts: dict[float, Rollout], truth: Array
) -> None:
    """One line for every coordinate, in its own unit."""
    plant = diagnosis.subject.plant
    for i, (name, unit) in enumerate(zip(plant.coordinates, plant.coordinate_units, strict=True)):
        order_line(
            diagnosis, integrator, f"largest error of {name} in one driven period",
            _errors(rollouts, i, truth), unit, max(1.0, float(np.abs(truth[:, 2 * i]).max())),
            exact="rounding, against SciPy", exactly=True,
        )  # fmt: skip


def _draw(
    diagnosis: Diagnosis, integrator: str, rollouts: dict[float, Rollout], truth: Array
) -> None:
    """Errors and evaluations of the plant over the ladder of steps."""
    plant = diagnosis.subject.plant
    seconds = len(truth[1:]) * diagnosis.subject.control_period
    costs = np.array([(r.evaluations or 0) / seconds for r in rollouts.values()])
    for i, (name, unit) in enumerate(zip(plant.coordinates, plant.coordinate_units, strict=True)):
        errors = _errors(rollouts, i, truth)
        diagnosis.draw(
            "refinement", integrator=integrator, coordinate=name, unit=unit,
            steps=np.array(list(errors)), errors=np.array(list(errors.values())),
            evaluations_per_second=costs,
            order=numerics.declared(integrator).order,
        )  # fmt: skip
