"""Damping and dry friction: what they take out, and whether the ledger closes on it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from integ_gym.envs import numerics
from integ_gym.envs.ops.ops import ARRAY, split_state
from integ_gym.envs.plants.interface import (
    Plant,
    controls_of,
    state_names,
    state_units,
)
from integ_gym.envs.plants.system import PlantSystem

from .bench import Rollout
from .lines import Diagnosis, Expectation, amount, near, undeclared
from .oscillations import LARGEST, largest_stable, spectral_radii
from .subject import RELEASE, Array, theory_of

RATIO = 0.1
"""Damping ratio of the motion that is followed."""

SWINGS = 4.0
"""Half oscillations after which friction has stopped the plant."""

SMOOTH = 0.2
"""Share of the largest speed over which friction is spread where the order of its ledger is
measured; at the plant's own it changes within a step."""

_DAMPED_PERIODS, _STOPPED_PERIODS = 3.0, 4.0
_SLOW = 1e-7
"""Speed at which resistance is linear in the speed."""
_SMALL = 1e-3
"""hω of the steps at which the damping limit is measured: the oscillation does not matter."""
_LANES = 300
_LIMIT_TOLERANCE = 0.03
_TAKEN_TOLERANCE = 0.05
"""Energy taken out by friction, relative to the exact one, this near is right."""


def diagnose_damping(diagnosis: Diagnosis) -> None:
    """Follow a damped motion, and raise the damping until one step makes the speed grow."""
    subject = diagnosis.subject
    names = subject.resistances("damping")
    if not names:
        return
    unit_rate = decay_rate(subject.varied(**dict.fromkeys(names, 1.0)), subject.rest)
    damped = dict.fromkeys(names, 2.0 * RATIO * subject.frequency / unit_rate)
    _add_ledger(diagnosis, damped, _DAMPED_PERIODS)
    grid = LARGEST * np.arange(1, _LANES + 1) / _LANES
    step = _SMALL / subject.frequency
    plant = subject.varied(**dict.fromkeys(names, grid / (step * unit_rate)))
    for integrator in diagnosis.integrators:
        radii = spectral_radii(plant, subject.rest, integrator, np.full(_LANES, step))
        limit, theory = largest_stable(grid, radii), theory_of(integrator)
        expectation = undeclared()
        if theory is not None:
            expectation = near(theory.decay_limit, _LIMIT_TOLERANCE, (limit,))
        quantity = "one step, linearized at rest: stable up to h × decay rate of"
        diagnosis.add(integrator, quantity, (limit,), "", expectation)


def _add_ledger(
    diagnosis: Diagnosis,
    parameters: Mapping[str, Any],
    periods: float,
    name: str = "",
    words: str = "",
) -> None:
    """The ledger of a resisted motion over some periods, and what it books as dissipated."""
    subject = diagnosis.subject
    duration = subject.round_up_duration(periods * subject.period)
    lost = independent_losses(diagnosis, parameters, duration)
    quantity = f"{words}, energy booked as dissipated".removeprefix(", ")
    for integrator in diagnosis.integrators:
        rollouts = diagnosis.follow(
            integrator, diagnosis.ladder(integrator), subject.start,
            name=name, duration=duration, **parameters,
        )  # fmt: skip
        diagnosis.add_ledger(integrator, rollouts, words)
        diagnosis.add_booked(integrator, rollouts, quantity, "dissipated", lost)


def independent_losses(
    diagnosis: Diagnosis, parameters: Mapping[str, Any], duration: float
) -> Array:
    """Energy that SciPy's motion with other parameters loses up to each instant, J."""
    subject = diagnosis.subject
    decisions = np.zeros(round(duration / subject.control_period))
    plant = subject.varied(**parameters)
    motion = numerics.independent_motion(plant, subject.start, decisions, subject.control_period)
    return motion.lost


def decay_rate(plant: Plant, rest: Array) -> float:
    """Fastest decay of a velocity at rest, 1/s; friction included.

    Args:
        plant: with numbers as parameters.
        rest: state order, shape (n,).
    """
    q, _ = split_state(tuple(rest))
    n = len(q)
    slow, none = tuple(_SLOW * np.eye(n)), controls_of(plant, 0.0)
    rates, _ = PlantSystem(plant).rates(ARRAY, q, slow, none)
    matrix = -np.stack([np.broadcast_to(x, n) for x in rates]) / _SLOW
    return float(np.abs(np.linalg.eigvals(matrix)).max())


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
    friction: dict[str, Any] = dict.fromkeys(names, level)
    duration = subject.round_up_duration(_STOPPED_PERIODS * subject.period)
    lost = independent_losses(diagnosis, friction, duration)[-1]
    for integrator in diagnosis.integrators:
        steps = diagnosis.steps(integrator)
        rollouts = diagnosis.follow(integrator, steps, subject.start, duration=duration, **friction)
        theory, stiff = theory_of(integrator), subject.control_period * level * unit_rate
        why = ""
        if theory is not None and stiff > theory.decay_limit:
            why = f"; h × rate = {stiff:.2g} is above {theory.decay_limit:.2g}"
        _add_creep(diagnosis, integrator, rollouts, why)
        taken = tuple(float(r.so_far("dissipated")[-1, 0]) for r in rollouts.values())
        diagnosis.add(
            integrator, "energy booked as dissipated", taken, "J",
            near(lost, _TAKEN_TOLERANCE * lost, taken, "J", f"SciPy's{why}"), steps=steps,
        )  # fmt: skip
    spread = SMOOTH * RELEASE * subject.frequency
    _add_ledger(
        diagnosis, {**friction, "friction_speed": spread}, 1.0, "smooth", "smoothed friction"
    )


def _add_creep(
    diagnosis: Diagnosis, integrator: str, rollouts: Mapping[float, Rollout], why: str
) -> None:
    """Speeds in the last quarter of the motion, of the coordinate that is fastest then."""
    plant: Any = diagnosis.subject.plant
    late = [r.state[-(len(r.time) // 4) :, 0, 1::2] for r in rollouts.values()]
    speeds = np.abs(np.array(late)).max(axis=1)
    worst = int(np.nan_to_num(speeds, nan=math.inf).max(axis=0).argmax())
    measured = speeds[:, worst].tolist()
    unit, most = state_units(plant)[1::2][worst], plant.friction_speed
    diagnosis.add(
        integrator,
        f"largest speed in the last quarter: worst of {', '.join(state_names(plant)[1::2])}",
        measured, unit,
        Expectation(
            f"creeps{why}", f"below {amount(most)} {unit}", all(x < most for x in measured)
        ),
        steps=tuple(rollouts),
    )  # fmt: skip
