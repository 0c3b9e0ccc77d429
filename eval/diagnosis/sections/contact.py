"""Contact: penetration, rebound and ledger of one impact, over step and stiffness."""

from __future__ import annotations

import math

import numpy as np

from integ_gym.envs.registries import TRUTH

from ..bench import Array as Array
from ..bench import Commands, Rollout
from ..experiments import PHASES, Impact, impact_of
from ..lines import (
    NO_CONTROL,
    Diagnosis,
    Expectation,
    ledger_line,
    near,
    said,
    solver_line,
    undeclared,
)
from ..subject import theory_of

HALVINGS = 6
"""Steps of the map, from the coarsest."""

STIFFNESSES = 13
"""Stiffnesses of the map."""

MAP_PHASES = 4
"""Touches of the map for every step and stiffness."""

RANGE = (0.25, 16.0)
"""hω of the mass on the stop at the coarsest step, from the softest to the stiffest stop."""

GAIN = 1e-6
"""Energy above this share of the impact's is gained: no passive stop gives any."""

SMALL = 0.02
"""hω of the mass on the stop at which the order of its ledger shows."""

PARTS = 4
"""Decisions in the time of a contact, at least: the ledger's residuals are added up over them."""

KINK = (2, "the force sets in with a kink")
"""Largest order of a step in which that happens."""

TOLERANCE = 0.05
"""Rebound energy as a share, and penetration relative to the exact one, this near are right."""


def diagnose_contact(diagnosis: Diagnosis) -> None:
    """Let the plant run into its stop, at many steps and stiffnesses."""
    impact = impact_of(diagnosis.subject)
    if impact is None:
        return
    for integrator in diagnosis.integrators:
        _at_default(diagnosis, integrator, impact)
        if integrator != TRUTH:
            _map(diagnosis, integrator, impact)


def _strike(
    diagnosis: Diagnosis,
    integrator: str,
    impact: Impact,
    dt: float,
    stiffness: Array,
    phases: int,
    period: float,
) -> Rollout:
    """Lanes of every stiffness, one after the other in every phase; a period is a decision's."""
    subject = diagnosis.subject
    run_up = subject.control_period
    slowest = impact.rate(float(stiffness.min()))
    duration = math.ceil((4.0 * run_up + 1.5 * math.pi / slowest) / period) * period
    starts = np.repeat(impact.starts(dt, run_up, phases), len(stiffness), axis=0)
    return diagnosis.bench.open_loop(
        f"{diagnosis.section}/{len(stiffness)}/{integrator}/dt={dt:g}", subject, integrator, dt,
        Commands("zero", NO_CONTROL), starts, control_period=period, duration=duration,
        stop_stiffness=np.tile(stiffness, phases), **impact.arguments,
    )  # fmt: skip


def rebound(rollout: Rollout) -> Array:
    """Energy after the impact as a share of that before, shape (lanes,); inf where it diverged."""
    start, end = rollout.info["energy"][0], rollout.info["energy"][-1]
    share: Array = np.where(np.isfinite(end), end / start, np.inf)
    return share


def penetration(rollout: Rollout) -> Array:
    """Deepest penetration, m or rad, shape (lanes,); inf where it diverged."""
    deep = np.where(rollout.diverged(), np.inf, np.nanmax(rollout.info["penetration"], axis=0))
    return np.asarray(deep)


def _at_default(diagnosis: Diagnosis, integrator: str, impact: Impact) -> None:
    """At the plant's own stiffness, touched everywhere within a step."""
    subject, stiffness = diagnosis.subject, np.array([impact.stiffness])
    rate = impact.rate(impact.stiffness)
    steps = subject.ladder(rate, SMALL)
    if integrator == TRUTH:
        steps = steps[-1:]
    rollouts = {
        dt: _strike(
            diagnosis, integrator, impact, dt, stiffness, PHASES,
            subject.sampling(dt, math.pi / rate / PARTS),
        )
        for dt in steps
    }  # fmt: skip
    own_steps = steps if integrator == TRUTH else subject.steps
    own = [rollouts[dt] for dt in own_steps]
    left = [_worst(rebound(r), impact.rebound) for r in own]
    touches = f"worst of {PHASES} touches"
    diagnosis.add(
        integrator, f"share of energy left after the rebound, {touches}", left, "",
        near(impact.rebound, 1e-6 if integrator == TRUTH else TOLERANCE, left, "", "analytic"),
        steps=own_steps,
    )  # fmt: skip
    exact = impact.penetration(impact.stiffness)
    deep = [float(penetration(r).max()) for r in own]
    diagnosis.add(
        integrator, f"largest penetration of {PHASES} touches", deep, impact.unit,
        near(exact, TOLERANCE * exact, deep, impact.unit, "analytic"), steps=own_steps,
    )  # fmt: skip
    ledger_line(diagnosis, integrator, rollouts, f"mean of {PHASES} touches", at_most=KINK)
    solver_line(diagnosis, integrator, own, steps=own_steps)


def _worst(values: Array, wanted: float) -> float:
    return float(values[np.argmax(np.abs(values - wanted))])


def _map(diagnosis: Diagnosis, integrator: str, impact: Impact) -> None:
    """The impact over step and stiffness, and where it stops being passive."""
    coarsest = diagnosis.subject.control_period
    rates = np.geomspace(*RANGE, STIFFNESSES) / coarsest
    stiffness = impact.mass * rates**2
    steps = [coarsest / 2**k for k in range(HALVINGS)]
    rollouts = [
        _strike(diagnosis, integrator, impact, dt, stiffness, MAP_PHASES, coarsest) for dt in steps
    ]

    def over_map(values: list[Array]) -> Array:
        """Shape (steps, phases, stiffnesses)."""
        return np.array(values).reshape(HALVINGS, MAP_PHASES, STIFFNESSES)

    left = over_map([rebound(r) for r in rollouts])
    place = np.abs(left - impact.rebound).argmax(axis=1)[:, None]
    worst = np.take_along_axis(left, place, axis=1)[:, 0]
    exact = np.array([impact.penetration(float(k)) for k in stiffness])
    deep = over_map([penetration(r) for r in rollouts]).max(axis=1) / exact
    residual = over_map([r.residual() / impact.energy for r in rollouts]).mean(axis=1)
    gains = left.max(axis=1) > 1.0 + GAIN
    diagnosis.draw(
        "contact", integrator=integrator, steps=np.array(steps), stiffness=stiffness, rates=rates,
        rebound=worst - impact.rebound, penetration=deep - 1.0, residual=residual, gains=gains,
        unit=impact.stiffness_unit,
    )  # fmt: skip
    gaining = np.outer(steps, rates)[gains]
    limit = float(gaining.min()) if gaining.size else math.inf
    diagnosis.add(
        integrator,
        f"smallest hω of {HALVINGS} × {STIFFNESSES} steps and stiffnesses at which a rebound "
        "gains energy",
        (limit,), "", passive(integrator, limit),
    )  # fmt: skip


def passive(integrator: str, limit: float) -> Expectation:
    """What is expected of the hω from which an impact gains energy.

    The stop's potential is convex. An explicit step is a polynomial in hω, which outgrows any
    bound: well beyond the limit of an oscillator that is never left, the stop throws back more than
    it got. Damping and the way out move where that begins. No theory says how far: twice the limit,
    and 1 where there is none, are bounds that all built-in methods were seen to keep.
    """
    theory = theory_of(integrator)
    if theory is None:
        return undeclared()
    if theory.passive:
        return Expectation("at none: the potential is convex", "exactly", math.isinf(limit))
    if math.isinf(theory.oscillation_limit):
        return undeclared("no promise: an oscillator never grows")
    bound = 2.0 * theory.oscillation_limit or 1.0
    why = f"an oscillator grows above {said(theory.oscillation_limit)}"
    return Expectation(why, f"up to {said(bound)}", limit <= bound)
