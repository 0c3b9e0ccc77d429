"""Free motion: what each integrator does to the energy of an undriven, undamped plant."""

from __future__ import annotations

import math

import numpy as np

from integ_gym.envs.numerics import declared, energy_growth
from integ_gym.envs.numerics.energy import BOUNDED
from integ_gym.envs.plants.interface import state_names, state_units
from integ_gym.eval.diagnosis.expectation import Expectation, below, undeclared
from integ_gym.eval.diagnosis.order import EXACT, order_line
from integ_gym.eval.diagnosis.rollout import Array, Rollout
from integ_gym.eval.diagnosis.section import TRUTH, Diagnosis
from integ_gym.eval.diagnosis.solver import solver_line
from integ_gym.eval.diagnosis.theory import THEORY

SECTION = "free motion"

PERIODS = 8
"""Length of the motion in periods of the slowest small oscillation."""

DRAWN = 12
"""Length of the phase portraits in periods of the fastest small oscillation, at most."""

_PROBE = 0.5
"""hω at which theory is asked whether energy grows or decays."""


def diagnose_free_motion(diagnosis: Diagnosis) -> None:
    """Release the plant from rest displaced, and follow its energy."""
    for integrator in dict.fromkeys((*diagnosis.integrators, TRUTH)):
        rollouts = _release(
            diagnosis, integrator, diagnosis.steps(integrator), _duration(diagnosis)
        )
        _draw(diagnosis, integrator, rollouts[diagnosis.subject.control_period])
        if integrator in diagnosis.integrators:
            _one_period(diagnosis, integrator, rollouts)
            _long_run(diagnosis, integrator, rollouts)
            solver_line(diagnosis, integrator, list(rollouts.values()), steps=tuple(rollouts))


def _duration(diagnosis: Diagnosis) -> float:
    subject = diagnosis.subject
    return subject.rounded_duration(PERIODS * 2.0 * math.pi / subject.slowest)


def _release(
    diagnosis: Diagnosis, integrator: str, steps: tuple[float, ...], duration: float
) -> dict[float, Rollout]:
    subject = diagnosis.subject
    return diagnosis.follow(
        integrator, steps, subject.start, duration=duration, **subject.undamped
    )  # fmt: skip


def _change(rollout: Rollout) -> Array:
    """Energy change at every control instant as a share of the start's, shape (instants,)."""
    energy = rollout.info["energy"][:, 0]
    change: Array = energy / energy[0] - 1.0
    return change


def _one_period(diagnosis: Diagnosis, integrator: str, rollouts: dict[float, Rollout]) -> None:
    subject = diagnosis.subject
    finer = tuple(dt for dt in diagnosis.ladder(integrator) if dt not in rollouts)
    short = _release(diagnosis, integrator, finer, subject.rounded_duration(subject.period))
    instants = round(subject.rounded_duration(subject.period) / subject.control_period) + 1
    errors = {
        dt: 100.0 * float(np.abs(_change(r)[:instants]).max())
        for dt, r in {**rollouts, **short}.items()
    }
    quantity = "largest energy change in one period"
    order_line(diagnosis, integrator, quantity, errors, "%", 100.0)


def _long_run(diagnosis: Diagnosis, integrator: str, rollouts: dict[float, Rollout]) -> None:
    changes = [_change(r) for r in rollouts.values()]
    last = tuple(float(change[-1]) for change in changes)
    diagnosis.add(
        integrator, f"energy change after {PERIODS} periods", tuple(100.0 * x for x in last), "%",
        _promise(diagnosis, integrator, changes, last), steps=tuple(rollouts),
    )  # fmt: skip


def _promise(
    diagnosis: Diagnosis, integrator: str, changes: list[Array], last: tuple[float, ...]
) -> Expectation:
    """What theory says of the long run, and whether it holds."""
    if integrator == TRUTH:
        return below(100.0 * EXACT, tuple(100.0 * x for x in last), "%")
    if declared(integrator).symplectic:
        if not diagnosis.subject.plant.constant_mass_matrix:
            return undeclared("nothing: not symplectic where M depends on q")
        bounded = all(energy_growth(1.0 + change).kind == "bounded" for change in changes)
        return Expectation("bounded", f"drift of the mean up to {BOUNDED:g} of the ripple", bounded)
    theory = THEORY.get(integrator)
    if theory is None:
        return undeclared()
    if theory.energy_factor(_PROBE) > 1.0:
        return Expectation("grows, at any step", "above 0 %", not any(x <= 0.0 for x in last))
    return Expectation("decays, at any step", "below 0 %", all(x < 0.0 for x in last))


def _draw(diagnosis: Diagnosis, integrator: str, rollout: Rollout) -> None:
    subject = diagnosis.subject
    place = int(np.flatnonzero(subject.start != subject.rest)[-1])
    names, units = state_names(subject.plant), state_units(subject.plant)
    window = max(1, round(subject.period / subject.control_period))
    shown = DRAWN * window + 1
    diagnosis.draw(
        "free_motion", integrator=integrator, dt=subject.control_period,
        names=names[place : place + 2], units=units[place : place + 2],
        time=rollout.time, change=_change(rollout), window=window,
        position=rollout.state[:shown, 0, place], velocity=rollout.state[:shown, 0, place + 1],
    )  # fmt: skip
