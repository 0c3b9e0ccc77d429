"""Contact: penetration, rebound and ledger of one impact, over step and stiffness."""

from __future__ import annotations

import math

import numpy as np

from integ_gym.eval.diagnosis.bench import Array, Commands, Rollout
from integ_gym.eval.diagnosis.finding import shown
from integ_gym.eval.diagnosis.impact import Impact, impact_of
from integ_gym.eval.diagnosis.ledger import rough_ledger_line
from integ_gym.eval.diagnosis.section import TRUTH, Diagnosis, steps_for
from integ_gym.eval.diagnosis.subject import Subject
from integ_gym.eval.diagnosis.theory import THEORY

SECTION = "contact"

HALVINGS = 6
"""Steps of the map, from the coarsest."""

STIFFNESSES = 17
"""Stiffnesses of the map."""

RANGE = (0.25, 16.0)
"""hω of the mass on the stop at the coarsest step, from the softest to the stiffest stop."""

GAIN = 1e-6
"""Energy above this share of the impact's is gained: no passive stop gives any."""

_TOLERANCE = 0.05
"""Rebound energy, and penetration relative to the exact one, this near are right."""


def diagnose_contact(diagnosis: Diagnosis) -> None:
    """Let every plant run into its stop, at many steps and stiffnesses."""
    for subject, integrator in diagnosis.pairs():
        impact = impact_of(subject)
        if impact is None:
            continue
        _at_default(diagnosis, subject, integrator, impact)
        if integrator != TRUTH:
            _map(diagnosis, subject, integrator, impact)


def _strike(
    diagnosis: Diagnosis,
    subject: Subject,
    integrator: str,
    impact: Impact,
    dt: float,
    stiffness: Array,
    name: str,
) -> Rollout:
    slowest = impact.rate(float(stiffness.min()))
    duration = subject.rounded_duration(0.3 + 1.5 * math.pi / slowest)
    return diagnosis.bench.open_loop(
        f"contact/{name}/{integrator}/dt={dt:g}", subject, integrator, dt,
        Commands("zero", np.zeros(1)), np.tile(impact.start, (len(stiffness), 1)),
        duration=duration, stop_stiffness=stiffness, **impact.arguments,
    )  # fmt: skip


def _left(rollout: Rollout) -> Array:
    """Energy after the impact as a share of that before; inf where it diverged."""
    start, end = rollout.info["energy"][0], rollout.info["energy"][-1]
    share: Array = np.where(np.isfinite(end), end / start, np.inf)
    return share


def _at_default(diagnosis: Diagnosis, subject: Subject, integrator: str, impact: Impact) -> None:
    stiffness, steps = np.array([impact.stiffness]), steps_for(subject, integrator)
    rollouts = [
        _strike(diagnosis, subject, integrator, impact, dt, stiffness, "default") for dt in steps
    ]
    left = tuple(float(_left(r)[0]) for r in rollouts)
    tolerance = GAIN if integrator == TRUTH else _TOLERANCE
    expected = f"{impact.rebound:.3f} ± {tolerance:g}, analytic"
    holds = all(abs(x - impact.rebound) <= tolerance for x in left)
    diagnosis.add(
        SECTION, subject, integrator, "share of energy left after the rebound", left, "",
        expected, holds, steps=steps,
    )  # fmt: skip
    deep = tuple(float(np.nanmax(r.info["penetration"])) for r in rollouts)
    exact = impact.penetration(impact.stiffness)
    unit = subject.plant.coordinate_units[subject.plant.stopped]  # type: ignore[attr-defined]
    near = all(abs(x - exact) <= _TOLERANCE * exact for x in deep)
    diagnosis.add(
        SECTION, subject, integrator, "largest penetration", deep, unit,
        f"{exact:.3g} {unit} ± {100.0 * _TOLERANCE:g} %, analytic", near, steps=steps,
    )  # fmt: skip
    rough_ledger_line(diagnosis, SECTION, subject, integrator, rollouts)


def _map(diagnosis: Diagnosis, subject: Subject, integrator: str, impact: Impact) -> None:
    """Rebound over step and stiffness, and where it stops being passive."""
    coarsest = subject.steps[0]
    rates = np.geomspace(*RANGE, STIFFNESSES) / coarsest
    stiffness = impact.mass * rates**2
    steps = [coarsest / 2**k for k in range(HALVINGS)]
    rollouts = [
        _strike(diagnosis, subject, integrator, impact, dt, stiffness, "map") for dt in steps
    ]
    left = np.array([_left(r) for r in rollouts])
    h_omega = np.outer(steps, rates)
    diagnosis.draw(
        "contact", plant=subject.name, integrator=integrator, steps=steps,
        stiffness=stiffness.tolist(), rates=rates.tolist(), left=left.tolist(),
        expected=impact.rebound, unit=_unit(subject),
    )  # fmt: skip
    gains = h_omega[left > 1.0 + GAIN]
    limit = float(gains.min()) if gains.size else math.inf
    expected, holds = _passive(integrator, limit)
    diagnosis.add(
        SECTION, subject, integrator, "smallest hω at which a rebound gains energy", (limit,), "",
        expected, holds,
    )  # fmt: skip


def _unit(subject: Subject) -> str:
    return "N m/rad" if subject.plant.coordinate_units[0] == "rad" else "N/m"


def _passive(integrator: str, limit: float) -> tuple[str, bool | None]:
    """What linear theory says of the step from which an impact may gain energy.

    It speaks of an oscillator that is never left; the stop is, and it is damped.
    """
    theory = THEORY.get(integrator)
    if theory is None:
        return "not declared", None
    wanted = theory.oscillation_limit
    if wanted == 0.0:
        return "below 1: it pumps energy in", limit < 1.0
    if math.isinf(wanted):
        return "no promise; an oscillator never grows", None
    return f"no promise; an oscillator grows above {shown(wanted)}", None
