"""Stiffness: up to which step the plant's own fastest oscillation stays bounded."""

from __future__ import annotations

import math

import numpy as np

from integ_gym.envs import numerics
from integ_gym.envs.plants.interface import Plant

from ..bench import Array as Array
from ..bench import Rollout
from ..lines import (
    Diagnosis,
    Expectation,
    near,
    said,
    solver_line,
    undeclared,
)
from ..subject import theory_of

LARGEST = 6.0
"""hω up to which steps are tried."""

FOLLOWED = (0.5, 1.9, 2.1, 2.7, 3.0, 6.0)
"""hω at which a small oscillation is followed: on both sides of the limits of theory."""

STEPS = 100
"""Steps of each."""

DISPLACEMENT = 1e-4
"""Of the coordinate that moves most, at the start, m or rad: so far the plant is nearly linear."""

BLOWN_UP = 1e3
"""A factor on the energy above which an oscillation has grown. One that stays bounded may swing by
39 on the way to its limit, as symplectic Euler's does at hω = 1.9."""

GROWN = 2.0
"""A factor from the first quarter of the steps to the last above which it has grown slowly."""

_LINEAR = (1e-12, 1e6)
"""Factors on the energy between which an oscillation is neither rounding nor large."""
_LANES = 600
_WIDTH = 1e-5
"""Displacement of the central differences at rest, in which the plant is linear."""
_GROWTH = 1e-4
"""Growth per step that is no rounding; an eigenvalue pair that meets moves by its square root."""
_TOLERANCE = 0.02


def diagnose_stiffness(diagnosis: Diagnosis) -> None:
    """Find the step from which small oscillations grow, and follow some on either side of it."""
    grid = LARGEST * np.arange(1, _LANES + 1) / _LANES
    subject = diagnosis.subject
    plant = subject.varied(**subject.undamped)
    for integrator in diagnosis.integrators:
        radius = radii(plant, subject.rest, integrator, grid / subject.frequency)
        _limit(diagnosis, integrator, largest_stable(grid, radius))
        growths = _follow(diagnosis, integrator, numerics.fastest_mode(plant, subject.rest))
        diagnosis.draw(
            "stiffness", integrator=integrator, h_omega=grid, radius=radius,
            followed=np.array(FOLLOWED), growth=np.array(growths),
        )  # fmt: skip


def largest_stable(grid: Array, radius: Array) -> float:
    """The last value of an even grid before a spectral radius above 1; ``inf`` without one."""
    grows = np.flatnonzero(radius > 1.0 + _GROWTH)
    return math.inf if not grows.size else float(grid[grows[0]] - grid[0])


def _limit(diagnosis: Diagnosis, integrator: str, limit: float) -> None:
    rate, theory = diagnosis.subject.frequency, theory_of(integrator)
    expectation = undeclared()
    if theory is not None:
        wanted = theory.oscillation_limit
        off = _TOLERANCE * max(1.0, wanted) / rate
        expectation = near(wanted / rate, off, (limit / rate,), "s", _h_omega(wanted))
    quantity = f"one step, linearized at rest (ω = {rate:.4g} rad/s): stable up to a dt of"
    diagnosis.add(integrator, quantity, (limit / rate,), "s", expectation)


def _follow(diagnosis: Diagnosis, integrator: str, mode: Array) -> list[float]:
    """Follow small oscillations of a shape; factors on their amplitude per step."""
    rollouts = [_oscillation(diagnosis, integrator, mode, z) for z in FOLLOWED]
    factors = tuple(_factor(r) for r in rollouts)
    limit = numerics.stability_limit(integrator)
    right = all(
        grown(r) is (z > limit)
        for z, r in zip(FOLLOWED, rollouts, strict=True)
        if z <= limit or _shows(integrator, z)
    )
    at = ", ".join(f"{z:g}" for z in FOLLOWED)
    diagnosis.add(
        integrator, f"small oscillation, factor on its energy in {STEPS} steps of hω = {at}",
        factors, "",
        Expectation(
            _blows_up(limit), f"grown: above {BLOWN_UP:g}, or {GROWN:g}-fold in the last 3/4", right
        ),
    )  # fmt: skip
    stable = [z < limit for z in FOLLOWED]
    quantity = f"small oscillation, most solver iterations in a step of hω = {at}"
    solver_line(diagnosis, integrator, rollouts, quantity, stable=stable)
    return [_growth(r) for r in rollouts]


def _h_omega(limit: float) -> str:
    return "at any hω" if math.isinf(limit) else f"hω = {said(limit)}"


def _blows_up(limit: float) -> str:
    if limit == 0.0:
        return "grows at every hω"
    return "grows at no hω" if math.isinf(limit) else f"grows above hω = {said(limit)}"


def _oscillation(diagnosis: Diagnosis, integrator: str, mode: Array, h_omega: float) -> Rollout:
    subject = diagnosis.subject
    start = subject.rest.copy()
    start[0::2] += DISPLACEMENT * mode
    dt = h_omega / subject.frequency
    (rollout,) = diagnosis.follow(
        integrator, (dt,), start, control_period=dt, duration=STEPS * dt, **subject.undamped
    ).values()
    return rollout


def _factor(rollout: Rollout) -> float:
    """Largest energy of the last quarter by that of the start; NaN where it diverged."""
    energy = rollout.info["energy"][:, 0]
    return float(energy[-(len(energy) // 4) :].max() / energy[0])


def grown(rollout: Rollout) -> bool:
    """Whether an oscillation grew, at once or slowly; one that diverged did."""
    energy = rollout.info["energy"][:, 0]
    quarter = len(energy) // 4
    last = energy[-quarter:].max()
    return not (last <= BLOWN_UP * energy[0] and last <= GROWN * energy[:quarter].max())


def _shows(integrator: str, h_omega: float) -> bool:
    """Whether the growth of one step adds up to more than that within the steps followed."""
    radius = numerics.linear_map(integrator, h_omega).spectral_radius
    return not radius ** (1.5 * STEPS) < 1.2 * GROWN


def _growth(rollout: Rollout) -> float:
    """Factor on the amplitude per step for as long as the oscillation is small; NaN if never."""
    factors = rollout.info["energy"][1:, 0] / rollout.info["energy"][0, 0]
    outside = ~((factors > _LINEAR[0]) & (factors < _LINEAR[1]))
    steps = int(np.argmax(outside)) if outside.any() else len(factors)
    return float(factors[steps - 1] ** (0.5 / steps)) if steps else math.nan


def radii(plant: Plant, rest: Array, integrator: str, steps: Array) -> Array:
    """Largest |eigenvalue| of one step linearized at rest, per step size; shape (steps,).

    Args:
        plant: whose parameters may be one value per step size.
        rest: state order, shape (n,).
        integrator: a registered name or ``"module:Class"``.
        steps: s, shape (steps,).
    """
    n = len(rest)
    columns = []
    for direction in np.eye(n):
        ends = [
            numerics.advance_lanes(integrator, plant, np.tile(point, (len(steps), 1)), steps)
            for point in (rest + _WIDTH * direction, rest - _WIDTH * direction)
        ]
        columns.append((ends[0] - ends[1]) / (2.0 * _WIDTH))
    maps = np.nan_to_num(np.stack(columns, axis=-1), nan=1e9, posinf=1e9, neginf=-1e9)
    values: Array = np.abs(np.linalg.eigvals(maps)).max(axis=-1)
    return values
