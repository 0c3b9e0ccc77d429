"""Dry friction: what it takes out, and whether the plant comes to rest in it."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from integ_gym.eval.diagnosis.bench import Commands, Rollout
from integ_gym.eval.diagnosis.damping import decay_rate
from integ_gym.eval.diagnosis.ledger import rough_ledger_line
from integ_gym.eval.diagnosis.section import Diagnosis, steps_for
from integ_gym.eval.diagnosis.subject import RELEASE, Subject
from integ_gym.eval.diagnosis.theory import THEORY

SECTION = "friction"

SWINGS = 4.0
"""Half oscillations after which friction has stopped the plant."""

_PERIODS = 4.0


def diagnose_friction(diagnosis: Diagnosis) -> None:
    """Release every plant into dry friction that stops it after some swings."""
    for subject, integrator in diagnosis.pairs():
        names = list(subject.parameters("friction"))
        if not names or not hasattr(subject.plant, "friction_speed"):
            continue
        unit_rate = decay_rate(subject.varied(**dict.fromkeys(names, 1.0)), subject.rest)
        plant: Any = subject.plant
        # An oscillation in dry friction loses 2 c / (m ω²) of its amplitude per half period.
        level = RELEASE * subject.frequency**2 / (2.0 * SWINGS * unit_rate * plant.friction_speed)
        _rest(diagnosis, subject, integrator, names, level, level * unit_rate)


def _rest(
    diagnosis: Diagnosis,
    subject: Subject,
    integrator: str,
    names: list[str],
    level: float,
    rate: float,
) -> None:
    duration = subject.rounded_duration(_PERIODS * subject.period)
    rollouts = [
        diagnosis.bench.open_loop(
            f"friction/{integrator}/dt={dt:g}", subject, integrator, dt,
            Commands("zero", np.zeros(1)), subject.start[None], duration=duration,
            **dict.fromkeys(names, level),
        )
        for dt in steps_for(subject, integrator)
    ]  # fmt: skip
    plant: Any = subject.plant
    speeds = tuple(_late_speed(r) for r in rollouts)
    holds = all(x < plant.friction_speed for x in speeds)
    diagnosis.add(
        SECTION, subject, integrator, "largest speed once friction holds", speeds, "rad/s, m/s",
        f"creeps below {plant.friction_speed:g}{_stiff(subject, integrator, rate)}", holds,
        steps=steps_for(subject, integrator),
    )  # fmt: skip
    rough_ledger_line(diagnosis, SECTION, subject, integrator, rollouts)


def _late_speed(rollout: Rollout) -> float:
    """Largest speed in the last quarter; inf where the motion diverged."""
    late = np.abs(rollout.state[-(len(rollout.time) // 4) :, 0, 1::2])
    return float(late.max()) if np.isfinite(late).all() else math.inf


def _stiff(subject: Subject, integrator: str, rate: float) -> str:
    """How stiff the friction is at the coarsest step, if that is too stiff."""
    theory, stiff = THEORY.get(integrator), subject.steps[0] * rate
    if theory is None or stiff <= theory.decay_limit:
        return ""
    return f"; h × rate = {stiff:.2g}, above {theory.decay_limit:.2g}"
