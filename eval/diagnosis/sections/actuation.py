"""Actuation: what reaches the plant when commands exceed the actuator's limit."""

from __future__ import annotations

import math

import numpy as np

from integ_gym.envs import numerics
from integ_gym.envs.environment import environment_setup
from integ_gym.envs.tasks import FLOAT32_ROUNDING

from ..bench import Array as Array
from ..bench import Commands, Rollout
from ..lines import Diagnosis, Expectation, booked_line, ledger_line, near, said
from ..subject import Subject

LEVELS = (3.0, 0.6, -3.0, -0.6)
"""Commands in units of the actuator's limit, one after the other."""

HELD = 10
"""Decisions for which each is held, where all of them then take no more than two periods of the
slowest small oscillation: errors of longer motions say nothing of the order."""


def diagnose_actuation(diagnosis: Diagnosis) -> None:
    """Drive the plant from rest by commands within and beyond its limit."""
    subject = diagnosis.subject
    limit = actuator_limit(subject)
    levels = _levels(subject)
    commands = limit * levels
    within = np.clip(commands, -limit, limit)
    truth = numerics.independent_motion(subject.plant, subject.rest, within, subject.control_period)
    for integrator in diagnosis.integrators:
        rollouts = diagnosis.follow(
            integrator, diagnosis.ladder(integrator), subject.rest, commands, "levels",
            duration=len(commands) * subject.control_period, control_limit=limit,
        )  # fmt: skip
        _applied(diagnosis, integrator, commands, within, rollouts)
        booked_line(diagnosis, integrator, rollouts, "work booked", "actuator_work", truth.work)
        ledger_line(diagnosis, integrator, rollouts)
        for env_id in subject.environments:
            _environment(diagnosis, integrator, env_id, levels)


def _levels(subject: Subject) -> Array:
    """One command per decision, in units of the limit, shape (decisions,)."""
    two_periods = 4.0 * math.pi / subject.slowest
    held = math.floor(two_periods / (len(LEVELS) * subject.control_period))
    levels: Array = np.repeat(LEVELS, min(HELD, max(1, held)))
    return levels


def actuator_limit(subject: Subject) -> float:
    """The limit of the plant's own environment, or 1 in the plant's unit."""
    if not subject.environments:
        return 1.0
    return float(environment_setup(subject.environments[0], {}).task.control_limit)


def _applied(
    diagnosis: Diagnosis,
    integrator: str,
    commands: Array,
    within: Array,
    rollouts: dict[float, Rollout],
) -> None:
    """Every control that acted, and every count of saturation."""
    unit = diagnosis.subject.plant.control_unit
    own = {dt: rollouts[dt] for dt in diagnosis.steps(integrator)}
    acted = [r.info["control"][1:, 0] for r in own.values()]
    off = [largest(np.abs(x - within)) for x in acted]
    limit = f"{said(float(within.max()))} {unit}"
    diagnosis.add(
        integrator,
        f"largest |control − command|, commands up to {said(commands.max())} {unit} cut to {limit}",
        off, unit, near(0.0, 0.0, off, unit), steps=tuple(own),
    )  # fmt: skip
    counts = tuple(float(np.nansum(r.info["saturated"][1:])) for r in own.values())
    lived = tuple(int(np.isfinite(x).sum()) for x in acted)
    wanted = [int((np.abs(commands[:n]) > within.max()).sum()) for n in lived]
    expectation = Expectation(f"{wanted[-1]} of {lived[-1]}", "exactly", list(counts) == wanted)
    diagnosis.add(
        integrator, "decisions counted as saturated", counts, "", expectation, steps=tuple(own)
    )


def largest(values: Array) -> float:
    """Of the numbers that are some; NaN where none is."""
    numbers = values[np.isfinite(values)]
    return float(numbers.max()) if numbers.size else math.nan


def _environment(diagnosis: Diagnosis, integrator: str, env_id: str, levels: Array) -> None:
    """The same in an environment of the plant's own, with its own task."""
    task = environment_setup(env_id, {}).task
    if task.discrete is not None:
        return
    subject, limit = diagnosis.subject, float(task.control_limit)
    unit = subject.plant.control_unit
    rollout = diagnosis.bench.task(
        f"{diagnosis.section}/{integrator}", env_id, Commands("levels", limit * levels), 1,
        subject.rest[None], integrator=integrator, dt=subject.control_period,
        control_period=subject.control_period, duration=len(levels) * subject.control_period,
    )  # fmt: skip
    control, counted = (rollout.info[name][1:, 0] for name in ("control", "saturated"))
    lived = np.isfinite(control)
    beyond = np.abs(levels[lived]) > 1.0
    off = np.abs(control[lived] - limit * np.clip(levels[lived], -1.0, 1.0))
    rounding = FLOAT32_ROUNDING * limit
    wrong = np.count_nonzero((off > rounding) | (counted[lived] != beyond))
    diagnosis.add(
        integrator, f"{env_id}, decisions with a wrong control or count of saturation",
        (float(wrong),), "",
        Expectation(
            f"0 of {lived.sum()}", f"{said(rounding, unit)} off", bool(lived.any()) and wrong == 0
        ),
        steps=(subject.control_period,),
    )  # fmt: skip
