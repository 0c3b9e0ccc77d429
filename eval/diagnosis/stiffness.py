"""Stiffness: up to which step the plant's own fastest oscillation stays bounded."""

from __future__ import annotations

import math

import numpy as np

from integ_gym.envs.numerics.stepping import advance_lanes
from integ_gym.envs.plants.interface import Plant
from integ_gym.eval.diagnosis.bench import Array
from integ_gym.eval.diagnosis.section import Diagnosis
from integ_gym.eval.diagnosis.subject import Subject
from integ_gym.eval.diagnosis.theory import THEORY

SECTION = "stiffness"

LARGEST = 6.0
"""hω up to which steps are tried."""

_LANES = 600
_WIDTH = 1e-5
"""Displacement of the central differences at rest, in which the plant is linear."""
_GROWTH = 1e-4
"""Growth per step that is no rounding; an eigenvalue pair that meets moves by its square root."""
_TOLERANCE = 0.02


def diagnose_stiffness(diagnosis: Diagnosis) -> None:
    """Linearize one step at rest, for many steps at once, and find where it begins to grow."""
    grid = LARGEST * np.arange(1, _LANES + 1) / _LANES
    for subject, integrator in diagnosis.pairs():
        radius = spectral_radii(subject, integrator, grid / subject.frequency)
        diagnosis.draw(
            "stiffness", plant=subject.name, integrator=integrator,
            h_omega=grid.tolist(), radius=radius.tolist(),
        )  # fmt: skip
        grows = np.flatnonzero(radius > 1.0 + _GROWTH)
        limit = math.inf if not grows.size else float(grid[grows[0]]) - LARGEST / _LANES
        theory = THEORY.get(integrator)
        _line(
            diagnosis,
            subject,
            integrator,
            limit,
            None if theory is None else theory.oscillation_limit,
        )


def _line(
    diagnosis: Diagnosis, subject: Subject, integrator: str, limit: float, wanted: float | None
) -> None:
    rate = subject.frequency
    quantity = f"stable up to a dt of, where ω = {rate:.3g} rad/s"
    expected, holds = "not declared", None
    if wanted is not None:
        holds = limit == wanted or abs(limit - wanted) <= _TOLERANCE * max(1.0, wanted)
        expected = (
            "unbounded" if math.isinf(wanted) else f"{wanted / rate:.3g} s: hω = {wanted:.4g}"
        )
    diagnosis.add(SECTION, subject, integrator, quantity, (limit / rate,), "s", expected, holds)


def spectral_radii(subject: Subject, integrator: str, steps: Array) -> Array:
    """Largest |eigenvalue| of one step linearized at rest, per step size; shape (steps,)."""
    return radii(subject.plant, subject.rest, integrator, steps)


def radii(plant: Plant, rest: Array, integrator: str, steps: Array) -> Array:
    """The same for a plant whose parameters may be one value per step size."""
    n = len(rest)
    columns = []
    for direction in np.eye(n):
        ends = [
            advance_lanes(integrator, plant, np.tile(point, (len(steps), 1)), steps)
            for point in (rest + _WIDTH * direction, rest - _WIDTH * direction)
        ]
        columns.append((ends[0] - ends[1]) / (2.0 * _WIDTH))
    maps = np.nan_to_num(np.stack(columns, axis=-1), nan=1e9, posinf=1e9, neginf=-1e9)
    values: Array = np.abs(np.linalg.eigvals(maps)).max(axis=-1)
    return values
