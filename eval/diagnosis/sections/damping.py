"""Damping: what it takes out, whether the ledger closes, and how stiff it may be."""

from __future__ import annotations

from typing import Any

import numpy as np

from integ_gym.envs import numerics
from integ_gym.envs.engines.stepping import PlantSystem
from integ_gym.envs.ops.ops import ARRAY, split_state
from integ_gym.envs.plants.interface import Plant

from ..bench import Array as Array
from ..lines import Diagnosis, booked_line, ledger_line, near, undeclared
from ..subject import theory_of
from .stiffness import LARGEST, largest_stable, radii

RATIO = 0.1
"""Damping ratio of the motion that is followed."""

_PERIODS = 3.0
_SLOW = 1e-7
"""Speed at which resistance is linear in the speed."""
_SMALL = 1e-3
"""hω of the steps at which the damping limit is measured: the oscillation does not matter."""
_LANES = 300
_TOLERANCE = 0.03


def diagnose_damping(diagnosis: Diagnosis) -> None:
    """Follow a damped motion, and raise the damping until one step makes the speed grow."""
    subject = diagnosis.subject
    names = subject.resistances("damping")
    if not names:
        return
    unit_rate = decay_rate(subject.varied(**dict.fromkeys(names, 1.0)), subject.rest)
    damped: dict[str, Any] = dict.fromkeys(names, 2.0 * RATIO * subject.frequency / unit_rate)
    duration = subject.rounded_duration(_PERIODS * subject.period)
    truth = undriven(diagnosis, damped, duration)
    for integrator in diagnosis.integrators:
        rollouts = diagnosis.follow(
            integrator, diagnosis.ladder(integrator), subject.start, duration=duration, **damped
        )
        ledger_line(diagnosis, integrator, rollouts)
        quantity = "energy booked as dissipated"
        booked_line(diagnosis, integrator, rollouts, quantity, "dissipated", truth.lost)
        _limit(diagnosis, integrator, names, unit_rate)


def undriven(
    diagnosis: Diagnosis, parameters: dict[str, Any], duration: float
) -> numerics.IndependentMotion:
    """The plant with other parameters, released and followed by SciPy."""
    subject = diagnosis.subject
    decisions = np.zeros(round(duration / subject.control_period))
    plant = subject.varied(**parameters)
    return numerics.independent_motion(plant, subject.start, decisions, subject.control_period)


def decay_rate(plant: Plant, rest: Array) -> float:
    """Fastest decay of a velocity at rest, 1/s; friction included.

    Args:
        plant: with numbers as parameters.
        rest: state order, shape (n,).
    """
    q, _ = split_state(tuple(rest))
    n = len(q)
    rates, _ = PlantSystem(plant).rates(ARRAY, q, tuple(_SLOW * np.eye(n)), 0.0)
    matrix = -np.stack([np.broadcast_to(x, n) for x in rates]) / _SLOW
    return float(np.abs(np.linalg.eigvals(matrix)).max())


def _limit(diagnosis: Diagnosis, integrator: str, names: tuple[str, ...], unit_rate: float) -> None:
    subject = diagnosis.subject
    grid = LARGEST * np.arange(1, _LANES + 1) / _LANES
    step = _SMALL / subject.frequency
    plant = subject.varied(**dict.fromkeys(names, grid / (step * unit_rate)))
    limit = largest_stable(grid, radii(plant, subject.rest, integrator, np.full(_LANES, step)))
    theory = theory_of(integrator)
    expectation = undeclared() if theory is None else near(theory.decay_limit, _TOLERANCE, (limit,))
    quantity = "one step, linearized at rest: stable up to h × decay rate of"
    diagnosis.add(integrator, quantity, (limit,), "", expectation)
