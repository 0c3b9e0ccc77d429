"""Free motion and stiffness: the energy of what swings by itself, and the steps it stands."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from integ_gym.envs import numerics
from integ_gym.envs.plants.interface import Plant, state_names, state_units
from integ_gym.envs.registries import TRUTH

from .bench import Rollout
from .lines import EXACT, Diagnosis, Expectation, amount, below, near, undeclared
from .subject import Array, theory_of

PERIODS = 8
"""Length of the motion in periods of the slowest small oscillation."""

LEAST_STEPS = 200
"""Length of the motion in steps, at least."""

DRAWN = 12
"""Length of the phase portraits in periods of the fastest small oscillation, at most."""

SAMPLES = 32
"""Instants in a period of the fastest small oscillation at which energy is looked at, at least."""

SHOWS = 1e-10
"""A share of its energy that an oscillator must gain or lose for the sign to be no rounding."""


def diagnose_free_motion(diagnosis: Diagnosis) -> None:
    """Release the plant from rest displaced, and follow its energy."""
    subject = diagnosis.subject
    duration = PERIODS * 2.0 * math.pi / subject.slowest
    for integrator in dict.fromkeys((*diagnosis.integrators, TRUTH)):
        steps = diagnosis.steps(integrator)
        rollouts = _release(diagnosis, integrator, steps, duration, LEAST_STEPS)
        _draw(diagnosis, integrator, rollouts[subject.control_period])
        if integrator not in diagnosis.integrators:
            continue
        finer = tuple(dt for dt in diagnosis.ladder(integrator) if dt not in rollouts)
        errors = {}
        for dt, r in (rollouts | _release(diagnosis, integrator, finer, subject.period, 1)).items():
            within = r.time < subject.period + r.time[1]
            errors[dt] = 100.0 * float(np.abs(energy_change(r)[within]).max())
        quantity = "largest energy change in one period"
        diagnosis.add_order(integrator, quantity, errors, "%", 100.0)
        changes = {dt: energy_change(r) for dt, r in rollouts.items()}
        ends = [100.0 * change[-1] for change in changes.values()]
        diagnosis.add(
            integrator, f"energy change after {PERIODS} periods, {LEAST_STEPS} steps at least",
            ends, "%",
            below(100.0 * EXACT, ends, "%") if integrator == TRUTH
            else _long_run(diagnosis, integrator, changes, duration),
            steps=tuple(changes),
        )  # fmt: skip
        diagnosis.add_solver(integrator, list(rollouts.values()), steps=steps)


def _release(
    diagnosis: Diagnosis, integrator: str, steps: Sequence[float], duration: float, count: int
) -> dict[float, Rollout]:
    """Rollouts by step, of a duration in s and a number of steps at least."""
    subject = diagnosis.subject
    rollouts: dict[float, Rollout] = {}
    for dt in steps:
        period = subject.choose_sampling_interval(dt, subject.period / SAMPLES)
        decisions = math.ceil(max(duration, count * dt) / period - 1e-9)
        rollouts |= diagnosis.follow(
            integrator, (dt,), subject.start, control_period=period, duration=decisions * period,
            **subject.undamped,
        )  # fmt: skip
    return rollouts


def energy_change(rollout: Rollout) -> Array:
    """Energy change at every instant as a share of the start's, shape (instants,)."""
    energy = rollout.info["energy"][:, 0]
    return np.asarray(energy / energy[0] - 1.0)


def _long_run(
    diagnosis: Diagnosis, integrator: str, changes: Mapping[float, Array], duration: float
) -> Expectation:
    """What theory says of energy changes after a duration in s, and whether it holds."""
    subject, theory = diagnosis.subject, theory_of(integrator)
    if numerics.declared(integrator).symplectic:
        if not subject.plant.constant_mass_matrix:
            return undeclared("nothing: not symplectic where M depends on q")
        limit = numerics.stability_limit(integrator) / subject.frequency
        # Below the limit of stability; at all steps where there is no stable one.
        stable = [change for dt, change in changes.items() if limit == 0.0 or dt < limit]
        if not stable:
            return undeclared("nothing: every step is above its limit of stability")
        return Expectation(
            "bounded" if len(stable) == len(changes) else f"bounded below dt = {amount(limit)} s",
            f"drift of the mean up to {numerics.BOUNDED:g} of the ripple",
            all(numerics.energy_growth(1.0 + change).kind == "bounded" for change in stable),
        )
    if theory is None:
        return undeclared()
    exponents = {
        dt: duration / dt * math.log(theory.energy_factor(dt * subject.frequency)) for dt in changes
    }
    return trend(exponents, {dt: float(change[-1]) for dt, change in changes.items()})


def trend(exponents: Mapping[float, float], changes: Mapping[float, float]) -> Expectation:
    """Whether energy grew or decayed as an oscillator's does.

    Args:
        exponents: logarithms of the factor on an oscillator's energy by the end, by step in s.
        changes: of the energy by the end, as a share; NaN where the motion diverged.
    """
    judged = [dt for dt, exponent in exponents.items() if abs(exponent) > SHOWS]
    if not judged:
        return undeclared("nothing but rounding at these steps")
    grows = [exponents[dt] > 0.0 for dt in judged]
    words = "grows" if all(grows) else "decays" if not any(grows) else "grows at large steps alone"
    holds = all((not changes[dt] <= 0.0) is up for dt, up in zip(judged, grows, strict=True))
    return Expectation(words, "of that sign", holds)


def _draw(diagnosis: Diagnosis, integrator: str, rollout: Rollout) -> None:
    subject = diagnosis.subject
    place = int(np.flatnonzero(subject.start != subject.rest)[-1])
    window = max(1, round(subject.period / rollout.time[1]))
    drawn = rollout.state[: DRAWN * window + 1, 0]
    diagnosis.draw(
        "free_motion", integrator=integrator, dt=subject.control_period,
        names=state_names(subject.plant)[place : place + 2],
        units=state_units(subject.plant)[place : place + 2],
        time=rollout.time, change=energy_change(rollout), window=window,
        position=drawn[:, place], velocity=drawn[:, place + 1],
    )  # fmt: skip


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
    subject, rate = diagnosis.subject, diagnosis.subject.frequency
    plant = subject.varied(**subject.undamped)
    start = subject.rest.copy()
    start[0::2] += DISPLACEMENT * numerics.fastest_mode(plant, subject.rest)
    for integrator in diagnosis.integrators:
        radius = spectral_radii(plant, subject.rest, integrator, grid / rate)
        limit, theory = largest_stable(grid, radius), theory_of(integrator)
        expectation = undeclared()
        if theory is not None:
            wanted = theory.oscillation_limit
            why = "at any hω" if math.isinf(wanted) else f"hω = {amount(wanted)}"
            off = _TOLERANCE * max(1.0, wanted) / rate
            expectation = near(wanted / rate, off, (limit / rate,), "s", why)
        quantity = f"one step, linearized at rest (ω = {rate:.4g} rad/s): stable up to a dt of"
        diagnosis.add(integrator, quantity, (limit / rate,), "s", expectation)
        rollouts: list[Rollout] = []
        for dt in (z / rate for z in FOLLOWED):
            rollouts += diagnosis.follow(
                integrator, (dt,), start, control_period=dt, duration=STEPS * dt,
                **subject.undamped,
            ).values()  # fmt: skip
        _add_growth(diagnosis, integrator, rollouts)
        diagnosis.draw(
            "stiffness", integrator=integrator, h_omega=grid, radius=radius,
            followed=np.array(FOLLOWED), growth=np.array([_growth(r) for r in rollouts]),
        )  # fmt: skip


def largest_stable(grid: Array, radius: Array) -> float:
    """The last value of an even grid before a spectral radius above 1; ``inf`` without one."""
    grows = np.flatnonzero(radius > 1.0 + _GROWTH)
    return math.inf if not grows.size else float(grid[grows[0]] - grid[0])


def _add_growth(diagnosis: Diagnosis, integrator: str, rollouts: Sequence[Rollout]) -> None:
    """Whether followed oscillations grew where they should, and whether their steps were solved."""
    limit = numerics.stability_limit(integrator)
    factors, right = [], True
    for z, rollout in zip(FOLLOWED, rollouts, strict=True):
        energy = rollout.info["energy"][:, 0]
        factors.append(float(energy[-(len(energy) // 4) :].max() / energy[0]))
        grows = z > limit
        radius = numerics.linear_map(integrator, z).spectral_radius if grows else math.inf
        if not radius ** (1.5 * STEPS) < 1.2 * GROWN:  # else the steps followed are too few
            right = right and has_grown(rollout) is grows
    words = f"grows above hω = {amount(limit)}"
    if limit == 0.0 or math.isinf(limit):
        words = "grows at every hω" if limit == 0.0 else "grows at no hω"
    at = ", ".join(f"{z:g}" for z in FOLLOWED)
    diagnosis.add(
        integrator, f"small oscillation, factor on its energy in {STEPS} steps of hω = {at}",
        factors, "",
        Expectation(words, f"grown: above {BLOWN_UP:g}, or {GROWN:g}-fold in the last 3/4", right),
    )  # fmt: skip
    quantity = f"small oscillation, most solver iterations in a step of hω = {at}"
    diagnosis.add_solver(integrator, rollouts, quantity, stable=[z < limit for z in FOLLOWED])


def has_grown(rollout: Rollout) -> bool:
    """Whether an oscillation grew, at once or slowly; one that diverged did."""
    energy = rollout.info["energy"][:, 0]
    quarter = len(energy) // 4
    last = energy[-quarter:].max()
    return not (last <= BLOWN_UP * energy[0] and last <= GROWN * energy[:quarter].max())


def _growth(rollout: Rollout) -> float:
    """Factor on the amplitude per step for as long as the oscillation is small; NaN if never."""
    factors = rollout.info["energy"][1:, 0] / rollout.info["energy"][0, 0]
    outside = ~((factors > _LINEAR[0]) & (factors < _LINEAR[1]))
    steps = int(np.argmax(outside)) if outside.any() else len(factors)
    return float(factors[steps - 1] ** (0.5 / steps)) if steps else math.nan


def spectral_radii(plant: Plant, rest: Array, integrator: str, steps: Array) -> Array:
    """Largest |eigenvalue| of one step linearized at rest, per step size; shape (steps,).

    Args:
        plant: whose parameters may be one value per step size.
        rest: state order, shape (n,).
        integrator: a registered name or ``"module:Class"``.
        steps: s, shape (steps,).
    """
    columns = []
    for direction in _WIDTH * np.eye(len(rest)):
        ends = [
            numerics.advance_lanes(integrator, plant, np.tile(point, (len(steps), 1)), steps)
            for point in (rest + direction, rest - direction)
        ]
        columns.append((ends[0] - ends[1]) / (2.0 * _WIDTH))
    maps = np.nan_to_num(np.stack(columns, axis=-1), nan=1e9, posinf=1e9, neginf=-1e9)
    return np.asarray(np.abs(np.linalg.eigvals(maps)).max(axis=-1))
