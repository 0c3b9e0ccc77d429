"""Free motion: what each integrator does to the energy of an undriven, undamped plant."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from integ_gym.envs import numerics
from integ_gym.envs.plants.interface import state_names, state_units
from integ_gym.envs.registries import TRUTH

from ..bench import Array as Array
from ..bench import Rollout
from ..lines import (
    EXACT,
    Diagnosis,
    Expectation,
    below,
    order_line,
    said,
    solver_line,
    undeclared,
)
from ..subject import theory_of

PERIODS = 8
"""Length of the motion in periods of the slowest small oscillation."""

STEPS = 200
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
    for integrator in dict.fromkeys((*diagnosis.integrators, TRUTH)):
        steps = diagnosis.steps(integrator)
        rollouts = _release(diagnosis, integrator, steps, PERIODS * _slowest(diagnosis), STEPS)
        _draw(diagnosis, integrator, rollouts[subject.control_period])
        if integrator in diagnosis.integrators:
            finer = tuple(dt for dt in diagnosis.ladder(integrator) if dt not in rollouts)
            short = _release(diagnosis, integrator, finer, subject.period, 1)
            _one_period(diagnosis, integrator, {**rollouts, **short})
            _long_run(diagnosis, integrator, rollouts)
            solver_line(diagnosis, integrator, list(rollouts.values()), steps=steps)


def _slowest(diagnosis: Diagnosis) -> float:
    """Period of the slowest small oscillation, s."""
    return 2.0 * math.pi / diagnosis.subject.slowest


def _release(
    diagnosis: Diagnosis, integrator: str, steps: Sequence[float], duration: float, count: int
) -> dict[float, Rollout]:
    """Rollouts by step, of a duration in s and a number of steps at least."""
    subject = diagnosis.subject
    rollouts: dict[float, Rollout] = {}
    for dt in steps:
        period = subject.sampling(dt, subject.period / SAMPLES)
        decisions = math.ceil(max(duration, count * dt) / period - 1e-9)
        rollouts |= diagnosis.follow(
            integrator, (dt,), subject.start, control_period=period, duration=decisions * period,
            **subject.undamped,
        )  # fmt: skip
    return rollouts


def _change(rollout: Rollout) -> Array:
    """Energy change at every instant as a share of the start's, shape (instants,)."""
    energy = rollout.info["energy"][:, 0]
    change: Array = energy / energy[0] - 1.0
    return change


def _one_period(diagnosis: Diagnosis, integrator: str, rollouts: dict[float, Rollout]) -> None:
    period = diagnosis.subject.period
    errors = {}
    for dt, rollout in rollouts.items():
        within = rollout.time < period + rollout.time[1]
        errors[dt] = 100.0 * float(np.abs(_change(rollout)[within]).max())
    quantity = "largest energy change in one period"
    order_line(diagnosis, integrator, quantity, errors, "%", 100.0)


def _long_run(diagnosis: Diagnosis, integrator: str, rollouts: dict[float, Rollout]) -> None:
    changes = {dt: _change(r) for dt, r in rollouts.items()}
    diagnosis.add(
        integrator, f"energy change after {PERIODS} periods, {STEPS} steps at least",
        [100.0 * change[-1] for change in changes.values()], "%",
        _promise(diagnosis, integrator, changes), steps=tuple(changes),
    )  # fmt: skip


def _promise(diagnosis: Diagnosis, integrator: str, changes: dict[float, Array]) -> Expectation:
    """What theory says of the long run, and whether it holds."""
    subject, theory = diagnosis.subject, theory_of(integrator)
    if integrator == TRUTH:
        return below(100.0 * EXACT, [100.0 * change[-1] for change in changes.values()], "%")
    if numerics.declared(integrator).symplectic:
        if not subject.plant.constant_mass_matrix:
            return undeclared("nothing: not symplectic where M depends on q")
        return _bounded(changes, numerics.stability_limit(integrator) / subject.frequency)
    if theory is None:
        return undeclared()
    duration = PERIODS * _slowest(diagnosis)
    exponents = {
        dt: duration / dt * math.log(theory.energy_factor(dt * subject.frequency)) for dt in changes
    }
    return trend(exponents, {dt: float(change[-1]) for dt, change in changes.items()})


def _bounded(changes: dict[float, Array], limit: float) -> Expectation:
    """At the steps, in s, below the limit of stability; at all where there is no stable step."""
    stable = [change for dt, change in changes.items() if limit == 0.0 or dt < limit]
    if not stable:
        return undeclared("nothing: every step is above its limit of stability")
    return Expectation(
        "bounded" if len(stable) == len(changes) else f"bounded below dt = {said(limit)} s",
        f"drift of the mean up to {numerics.BOUNDED:g} of the ripple",
        all(numerics.energy_growth(1.0 + change).kind == "bounded" for change in stable),
    )


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
    names, units = state_names(subject.plant), state_units(subject.plant)
    window = max(1, round(subject.period / rollout.time[1]))
    drawn = DRAWN * window + 1
    diagnosis.draw(
        "free_motion", integrator=integrator, dt=subject.control_period,
        names=names[place : place + 2], units=units[place : place + 2],
        time=rollout.time, change=_change(rollout), window=window,
        position=rollout.state[:drawn, 0, place], velocity=rollout.state[:drawn, 0, place + 1],
    )  # fmt: skip
