"""Free motion: what each integrator does to the energy of an undriven, undamped plant."""

from __future__ import annotations

import numpy as np

from integ_gym.envs.integrators import INTEGRATORS
from integ_gym.envs.numerics import declared
from integ_gym.envs.plants.interface import state_names
from integ_gym.eval.diagnosis.bench import Array, Commands
from integ_gym.eval.diagnosis.order import promised
from integ_gym.eval.diagnosis.section import TRUTH, Diagnosis, steps_for
from integ_gym.eval.diagnosis.subject import Subject
from integ_gym.eval.diagnosis.theory import THEORY

SECTION = "free motion"

PERIODS = 8.0
"""Length of the motion in periods of the fastest small oscillation."""

_EXACT = 1e-9
"""Relative energy change that is rounding."""

_BOUNDED = 1.1
"""A second half with an energy error this much larger than the first's is no longer bounded."""

_PROBE = 0.5
"""hω at which theory is asked whether energy grows or decays."""


def diagnose_free_motion(diagnosis: Diagnosis) -> None:
    """Release every plant from rest displaced, and follow its energy."""
    for subject, integrator in diagnosis.pairs():
        duration = subject.rounded_duration(PERIODS * subject.period)
        steps = steps_for(subject, integrator)
        motions = [_release(diagnosis, subject, integrator, dt, duration) for dt in steps]
        changes = [change for change, _ in motions]
        _first_period(diagnosis, subject, integrator, changes, steps)
        _long_run(diagnosis, subject, integrator, changes, steps)
        _solver(diagnosis, subject, integrator, tuple(most for _, most in motions), steps)


def _solver(
    diagnosis: Diagnosis,
    subject: Subject,
    integrator: str,
    iterations: tuple[float, ...],
    steps: tuple[float, ...],
) -> None:
    """How hard the integrator's solver worked, if it has one."""
    cap = getattr(INTEGRATORS.load(integrator), "solver_cap", None)
    if cap is not None:
        diagnosis.add(
            SECTION, subject, integrator, "most solver iterations in a step", iterations, "",
            f"below the cap of {cap}", max(iterations) < cap, steps=steps,
        )  # fmt: skip


def _release(
    diagnosis: Diagnosis, subject: Subject, integrator: str, dt: float, duration: float
) -> tuple[Array, float]:
    """Relative energy change at every control instant, shape (instants,), and most iterations."""
    rollout = diagnosis.bench.open_loop(
        f"free_motion/{integrator}/dt={dt:g}", subject, integrator, dt,
        Commands("zero", np.zeros(1)), subject.start[None], duration=duration,
    )  # fmt: skip
    energy = rollout.info["energy"][:, 0]
    if dt == subject.steps[0]:
        shown = _shown_coordinate(subject)
        diagnosis.draw(
            "free_motion", plant=subject.name, integrator=integrator, dt=dt,
            coordinate=state_names(subject.plant)[shown],
            units=[subject.plant.coordinate_units[shown // 2]],
            time=rollout.time.tolist(), energy=(energy / energy[0]).tolist(),
            position=rollout.state[:, 0, shown].tolist(),
            velocity=rollout.state[:, 0, shown + 1].tolist(),
        )  # fmt: skip
    change: Array = energy / energy[0] - 1.0
    return change, float(np.nanmax(rollout.info["solver_iterations"]))


def _shown_coordinate(subject: Subject) -> int:
    """Place in the state of the coordinate that was displaced."""
    return int(np.flatnonzero(subject.start != subject.rest)[-1])


def _first_period(
    diagnosis: Diagnosis,
    subject: Subject,
    integrator: str,
    changes: list[Array],
    steps: tuple[float, ...],
) -> None:
    instants = round(subject.period / subject.control_period) + 1
    largest = tuple(float(np.max(np.abs(change[:instants]))) for change in changes)
    line = (SECTION, subject, integrator, "largest energy change in one period")
    measured = tuple(100.0 * x for x in largest)
    if integrator == TRUTH:
        expected = f"rounding: below {100.0 * _EXACT:g} %"
        diagnosis.add(*line, measured, "%", expected, max(largest) < _EXACT, steps=steps)
        return
    expected, holds = promised(subject, integrator, largest, _EXACT)
    diagnosis.add(*line, measured, "%", expected, holds, steps=steps)


def _long_run(
    diagnosis: Diagnosis,
    subject: Subject,
    integrator: str,
    changes: list[Array],
    steps: tuple[float, ...],
) -> None:
    last = tuple(float(change[np.isfinite(change)][-1]) for change in changes)
    line = (SECTION, subject, integrator, f"energy change after {PERIODS:g} periods")
    measured = tuple(100.0 * x for x in last)
    expected, holds = _promise(subject, integrator, changes, last)
    diagnosis.add(*line, measured, "%", expected, holds, steps=steps)


def _promise(
    subject: Subject, integrator: str, changes: list[Array], last: tuple[float, ...]
) -> tuple[str, bool | None]:
    """What theory says of the long run, and whether it holds."""
    if integrator == TRUTH:
        return f"rounding: below {100.0 * _EXACT:g} %", max(map(abs, last)) < _EXACT
    if declared(integrator).symplectic:
        if subject.plant.constant_mass_matrix:
            return "bounded: no trend", all(_is_bounded(change) for change in changes)
        return "nothing: not symplectic where M depends on q", None
    theory = THEORY.get(integrator)
    if theory is None:
        return "not declared", None
    if theory.energy_factor(_PROBE) > 1.0:
        return "pumps energy in at every step", min(last) > 0.0
    return "drains energy at every step", max(last) < 0.0


def _is_bounded(change: Array) -> bool:
    if not np.isfinite(change).all():
        return False
    first, second = np.array_split(np.abs(change), 2)
    return bool(second.max() <= _BOUNDED * first.max())
