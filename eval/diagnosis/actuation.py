"""Actuation: what reaches the plant when commands exceed the actuator's limit."""

from __future__ import annotations

import numpy as np

from integ_gym.envs.registration import environment_setup
from integ_gym.eval.diagnosis.bench import Commands, Rollout
from integ_gym.eval.diagnosis.ledger import ledger_line
from integ_gym.eval.diagnosis.section import Diagnosis, steps_for
from integ_gym.eval.diagnosis.subject import Subject

SECTION = "actuation"

BEYOND = 3.0
"""Commands in units of the actuator's limit."""

DECISIONS = 40
_HALF_WAVE = 10
_EXACT = 1e-12


def diagnose_actuation(diagnosis: Diagnosis) -> None:
    """Drive every plant by a square wave beyond its limit, from rest."""
    for subject, integrator in diagnosis.pairs():
        limit = actuator_limit(subject)
        wave = BEYOND * limit * np.where(np.arange(DECISIONS) // _HALF_WAVE % 2, -1.0, 1.0)
        rollouts = [
            diagnosis.bench.open_loop(
                f"actuation/{integrator}/dt={dt:g}", subject, integrator, dt,
                Commands("square_wave", wave), subject.rest[None],
                duration=DECISIONS * subject.control_period, control_limit=limit,
            )
            for dt in steps_for(subject, integrator)
        ]  # fmt: skip
        _saturation(diagnosis, subject, integrator, limit, rollouts)
        _work(diagnosis, subject, integrator, rollouts)
        ledger_line(diagnosis, SECTION, subject, integrator, rollouts)


def actuator_limit(subject: Subject) -> float:
    """The limit of the plant's own environment, or 1 in the control's SI unit."""
    if not subject.environments:
        return 1.0
    return float(environment_setup(subject.environments[0], {}).task.control_limit)


def _saturation(
    diagnosis: Diagnosis, subject: Subject, integrator: str, limit: float, rollouts: list[Rollout]
) -> None:
    unit = subject.plant.control_unit
    applied = tuple(float(np.nanmax(np.abs(r.info["control"]))) for r in rollouts)
    counted = all(np.nansum(r.info["saturated"]) == DECISIONS for r in rollouts)
    diagnosis.add(
        SECTION, subject, integrator, f"largest control for commands of ±{BEYOND * limit:g} {unit}",
        applied, unit, f"{limit:g} {unit}, every decision counted as saturated",
        all(x == limit for x in applied) and counted, steps=steps_for(subject, integrator),
    )  # fmt: skip


def _work(diagnosis: Diagnosis, subject: Subject, integrator: str, rollouts: list[Rollout]) -> None:
    """The control is held over a decision, so its work is control times displacement."""
    gaps = []
    for rollout in rollouts:
        position = rollout.state[:, 0, 2 * subject.plant.actuated]
        by_hand = rollout.info["control"][1:, 0] * np.diff(position)
        booked = rollout.info["actuator_work"][1:, 0]
        gaps.append(float(np.nanmax(np.abs(booked - by_hand)) / np.nanmax(np.abs(by_hand))))
    diagnosis.add(
        SECTION, subject, integrator, "work booked − control × displacement, relative",
        tuple(gaps), "", f"rounding: below {_EXACT:g}", max(gaps) < _EXACT,
        steps=steps_for(subject, integrator),
    )  # fmt: skip
