"""What each integrator is: order, symplecticity, reversibility, stability, energy per step."""

from __future__ import annotations

import math

from integ_gym.envs.numerics import classify, declared, linear_map, stability_limit
from integ_gym.envs.numerics.identity import ORDER_TOLERANCE, REVERSIBLE, SYMPLECTIC
from integ_gym.eval.diagnosis.finding import Finding, shown
from integ_gym.eval.diagnosis.section import TRUTH, Diagnosis
from integ_gym.eval.diagnosis.subject import Subject
from integ_gym.eval.diagnosis.theory import THEORY

SECTION = "integrator"

Z = 0.2
"""hω at which the energy factor is measured."""

_FACTOR_TOLERANCE = 1e-9
_LIMIT_TOLERANCE = 1e-4


def diagnose_identity(diagnosis: Diagnosis) -> None:
    """Classify every integrator on every plant."""
    for subject, integrator in diagnosis.pairs():
        _classified(diagnosis, subject, integrator)
        if diagnosis.leads:
            _linear(diagnosis, integrator)


def sentence(integrator: str) -> str:
    """What an integrator is on Gymnasium's pendulum, in one line."""
    found = classify(integrator)
    order = "exact to rounding" if found.order is None else f"order {found.order:.2f}"
    limit = found.stable_up_to
    stable = (
        "makes oscillations grow at every step size"
        if limit == 0.0
        else "stable at every step size"
        if math.isinf(limit)
        else f"stable up to hω = {limit:.4g}"
    )
    symplectic, reversible = (
        name if holds else f"not {name}"
        for name, holds in (("symplectic", found.symplectic), ("reversible", found.reversible))
    )
    return f"{integrator}: {order}, {symplectic}, {reversible}, {stable}"


def _classified(diagnosis: Diagnosis, subject: Subject, integrator: str) -> None:
    plant = subject.plant
    found, claim = classify(integrator, plant), declared(integrator)
    at = (SECTION, subject, integrator)
    if found.order is None:
        exact = integrator == TRUTH
        diagnosis.add(
            *at, "order of convergence", "exact to rounding", "",
            "exact to rounding" if exact else "none: no error to measure", exact or None,
        )  # fmt: skip
    else:
        holds = None if claim.order is None else abs(found.order - claim.order) <= ORDER_TOLERANCE
        expected = "not declared" if claim.order is None else f"{claim.order} ± {ORDER_TOLERANCE}"
        diagnosis.add(*at, "order of convergence", (found.order,), "", expected, holds)
    canonical, reason = _canonical(subject, integrator, claim.symplectic)
    diagnosis.add(
        *at, "symplectic: max |JᵀΩJ − Ω|", (found.symplecticity_defect,), "",
        reason, None if canonical is None else found.symplectic is canonical, steps=(found.dt,),
    )  # fmt: skip
    back = True if integrator == TRUTH else claim.reversible
    words = {
        True: f"reversible: below {REVERSIBLE:g}",
        False: f"not reversible: above {REVERSIBLE:g}",
        None: "not declared",
    }[back]
    diagnosis.add(
        *at, "reversible: forward, turn, back", (found.reversibility_defect,), "SI",
        words, None if back is None else found.reversible is back, steps=(found.dt,),
    )  # fmt: skip


def _canonical(subject: Subject, integrator: str, claimed: bool | None) -> tuple[bool | None, str]:
    """Whether the step should be symplectic on this plant, and why."""
    if integrator == TRUTH:
        return True, f"the exact motion is: below {SYMPLECTIC:g}"
    if claimed is None:
        return None, "not declared"
    if not claimed:
        return False, f"not symplectic: above {SYMPLECTIC:g}"
    if not subject.plant.constant_mass_matrix:
        return False, f"not here, M depends on q: above {SYMPLECTIC:g}"
    return True, f"symplectic: below {SYMPLECTIC:g}"


def _linear(diagnosis: Diagnosis, integrator: str) -> None:
    """Once per integrator: what it does to a harmonic oscillator."""
    theory, claim = THEORY.get(integrator), declared(integrator)
    gain = linear_map(integrator, Z).spectral_radius ** 2 - 1.0
    limit = stability_limit(integrator)
    wanted, holds = "not declared", None
    bound, stays = "not declared", None
    if theory is not None:
        factor = theory.energy_factor(Z) - 1.0
        wanted = f"{shown(factor)}: {theory.formula}"
        holds = abs(gain - factor) <= _FACTOR_TOLERANCE
        bound = _limit_words(theory.oscillation_limit)
        stays = limit == theory.oscillation_limit or math.isclose(
            limit, theory.oscillation_limit, rel_tol=_LIMIT_TOLERANCE
        )
    elif claim.symplectic:
        wanted, holds = "0: declared symplectic", abs(gain) <= _FACTOR_TOLERANCE
    for quantity, measured, expected, verdict in (
        (f"share of energy gained per step at hω = {Z:g}", gain, wanted, holds),
        ("stable up to hω", limit, bound, stays),
    ):
        diagnosis.findings.append(
            Finding(SECTION, "oscillator", integrator, quantity, (measured,), "", expected, verdict)
        )


def _limit_words(limit: float) -> str:
    if limit == 0.0:
        return "0: grows at every step size"
    return "unbounded" if math.isinf(limit) else f"{limit:.6g}"
