"""Damping: what it takes out, whether the ledger closes, and how stiff it may be."""

from __future__ import annotations

import math

import numpy as np

from integ_gym.envs.array_ops import ARRAY
from integ_gym.envs.plants.interface import Plant, split_state
from integ_gym.envs.system import PlantSystem
from integ_gym.eval.diagnosis.bench import Array, Commands
from integ_gym.eval.diagnosis.ledger import ledger_line
from integ_gym.eval.diagnosis.section import Diagnosis, steps_for
from integ_gym.eval.diagnosis.stiffness import LARGEST, radii
from integ_gym.eval.diagnosis.subject import Subject
from integ_gym.eval.diagnosis.theory import THEORY

SECTION = "damping"

RATIO = 0.1
"""Damping ratio of the motion that is followed."""

_PERIODS = 3.0
_SLOW = 1e-7
"""Speed at which resistance is linear in the speed."""
_SMALL = 1e-3
"""hω of the steps at which the damping limit is measured: the oscillation does not matter."""
_LANES = 300
_GROWTH = 1e-4
_TOLERANCE = 0.03


def diagnose_damping(diagnosis: Diagnosis) -> None:
    """Follow a damped motion, and raise the damping until one step makes the speed grow."""
    for subject, integrator in diagnosis.pairs():
        names = [n for n in subject.parameters("damping") if not n.startswith("stop")]
        if not names:
            continue
        unit_rate = decay_rate(subject.varied(**dict.fromkeys(names, 1.0)), subject.rest)
        _ledger(diagnosis, subject, integrator, names, 2.0 * RATIO * subject.frequency / unit_rate)
        _limit(diagnosis, subject, integrator, names, unit_rate)


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


def _ledger(
    diagnosis: Diagnosis, subject: Subject, integrator: str, names: list[str], damping: float
) -> None:
    damped = dict.fromkeys(names, damping)
    duration = subject.rounded_duration(_PERIODS * subject.period)
    rollouts = [
        diagnosis.bench.open_loop(
            f"damping/{integrator}/dt={dt:g}", subject, integrator, dt,
            Commands("zero", np.zeros(1)), subject.start[None], duration=duration, **damped,
        )
        for dt in steps_for(subject, integrator)
    ]  # fmt: skip
    ledger_line(diagnosis, SECTION, subject, integrator, rollouts)
    taken = tuple(float(r.total("dissipated")[0]) for r in rollouts)
    start = float(rollouts[0].info["energy"][0, 0])
    holds = all(x > 0.0 for x in taken)
    diagnosis.add(
        SECTION, subject, integrator, f"energy taken out, of {start:.3g} J at the start", taken,
        "J", "never negative", holds, steps=steps_for(subject, integrator),
    )  # fmt: skip


def _limit(
    diagnosis: Diagnosis, subject: Subject, integrator: str, names: list[str], unit_rate: float
) -> None:
    grid = LARGEST * np.arange(1, _LANES + 1) / _LANES
    step = _SMALL / subject.frequency
    plant = subject.varied(**dict.fromkeys(names, grid / (step * unit_rate)))
    radius: Array = radii(plant, subject.rest, integrator, np.full(_LANES, step))
    grows = np.flatnonzero(radius > 1.0 + _GROWTH)
    limit = math.inf if not grows.size else float(grid[grows[0]]) - LARGEST / _LANES
    theory = THEORY.get(integrator)
    expected, holds = "not declared", None
    if theory is not None:
        wanted = theory.decay_limit
        holds = limit == wanted or abs(limit - wanted) <= _TOLERANCE
        expected = "unbounded" if math.isinf(wanted) else f"{wanted:.4g} ± {_TOLERANCE:g}"
    diagnosis.add(
        SECTION, subject, integrator, "stable up to h × decay rate", (limit,), "", expected, holds
    )
