"""Dry friction: what it takes out, and whether the plant comes to rest in it."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from integ_gym.envs.plants.interface import state_names, state_units

from ..bench import Rollout
from ..lines import Diagnosis, Expectation, booked_line, ledger_line, near, said
from ..subject import RELEASE, theory_of
from .damping import decay_rate, undriven

SWINGS = 4.0
"""Half oscillations after which friction has stopped the plant."""

SMOOTH = 0.2
"""Share of the largest speed over which friction is spread where the order of its ledger is
measured; at the plant's own it changes within a step."""

_PERIODS = 4.0
_TOLERANCE = 0.05
"""Energy taken out, relative to the exact one, this near is right."""


def diagnose_friction(diagnosis: Diagnosis) -> None:
    """Release the plant into dry friction that stops it after some swings."""
    subject = diagnosis.subject
    plant: Any = subject.plant
    names = subject.resistances("friction")
    if not names or not hasattr(plant, "friction_speed"):
        return
    unit_rate = decay_rate(subject.varied(**dict.fromkeys(names, 1.0)), subject.rest)
    # An oscillation in dry friction loses 2 c / (m ω²) of its amplitude per half period.
    level = RELEASE * subject.frequency**2 / (2.0 * SWINGS * unit_rate * plant.friction_speed)
    _at_rest(diagnosis, dict.fromkeys(names, level), level * unit_rate)
    spread: dict[str, Any] = {
        **dict.fromkeys(names, level),
        "friction_speed": SMOOTH * RELEASE * subject.frequency,
    }
    _smooth(diagnosis, spread)


def _at_rest(diagnosis: Diagnosis, friction: dict[str, Any], rate: float) -> None:
    """At the plant's own friction speed."""
    subject = diagnosis.subject
    duration = subject.rounded_duration(_PERIODS * subject.period)
    lost = undriven(diagnosis, friction, duration).lost[-1]
    for integrator in diagnosis.integrators:
        steps = diagnosis.steps(integrator)
        rollouts = diagnosis.follow(integrator, steps, subject.start, duration=duration, **friction)
        stiff = _stiff(diagnosis, integrator, rate)
        _creeping(diagnosis, integrator, rollouts, stiff)
        taken = tuple(float(r.so_far("dissipated")[-1, 0]) for r in rollouts.values())
        diagnosis.add(
            integrator, "energy booked as dissipated", taken, "J",
            near(lost, _TOLERANCE * lost, taken, "J", f"SciPy's{stiff}"), steps=steps,
        )  # fmt: skip


def _creeping(
    diagnosis: Diagnosis, integrator: str, rollouts: dict[float, Rollout], stiff: str
) -> None:
    """Speeds in the last quarter of the motion, of the coordinate that is fastest then."""
    plant: Any = diagnosis.subject.plant
    late = [r.state[-(len(r.time) // 4) :, 0, 1::2] for r in rollouts.values()]
    speeds = np.abs(np.array(late)).max(axis=1)
    worst = int(np.nan_to_num(speeds, nan=math.inf).max(axis=0).argmax())
    measured = tuple(speeds[:, worst].tolist())
    unit = state_units(plant)[1::2][worst]
    holds = all(x < plant.friction_speed for x in measured)
    expectation = Expectation(f"creeps{stiff}", f"below {said(plant.friction_speed)} {unit}", holds)
    names = ", ".join(state_names(plant)[1::2])
    diagnosis.add(
        integrator, f"largest speed in the last quarter: worst of {names}", measured, unit,
        expectation, steps=tuple(rollouts),
    )  # fmt: skip


def _stiff(diagnosis: Diagnosis, integrator: str, rate: float) -> str:
    """How stiff the friction is at the coarsest step, if that is too stiff."""
    theory, stiff = theory_of(integrator), diagnosis.subject.control_period * rate
    if theory is None or stiff <= theory.decay_limit:
        return ""
    return f"; h × rate = {stiff:.2g} is above {theory.decay_limit:.2g}"


def _smooth(diagnosis: Diagnosis, friction: dict[str, Any]) -> None:
    """Spread over enough speed for the ledger to converge at the method's order."""
    subject = diagnosis.subject
    duration = subject.rounded_duration(subject.period)
    truth = undriven(diagnosis, friction, duration)
    for integrator in diagnosis.integrators:
        rollouts = diagnosis.follow(
            integrator, diagnosis.ladder(integrator), subject.start, name="smooth",
            duration=duration, **friction,
        )  # fmt: skip
        ledger_line(diagnosis, integrator, rollouts, "smoothed friction")
        booked_line(
            diagnosis, integrator, rollouts, "smoothed friction, energy booked as dissipated",
            "dissipated", truth.lost,
        )  # fmt: skip
