"""What each integrator is on a plant: order, symplecticity, reversibility, stability."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from integ_gym.envs import numerics
from integ_gym.envs.plants.interface import state_names, state_units
from integ_gym.envs.registries import TRUTH

from ..lines import (
    Diagnosis,
    Expectation,
    above,
    below,
    near,
    said,
    undeclared,
)
from ..subject import theory_of

Z = 0.2
"""hω at which the energy factor is measured."""

_FACTOR_TOLERANCE = 1e-9
_LIMIT_TOLERANCE = 1e-4


def diagnose_identity(diagnosis: Diagnosis) -> None:
    """Classify every integrator on the plant without its resistances."""
    subject = diagnosis.subject
    plant = subject.varied(**subject.undamped)
    for integrator in diagnosis.integrators:
        advance = diagnosis.bench.advance(f"{diagnosis.section}/{integrator}", subject)
        found = numerics.classify(integrator, plant, follow=advance)
        claim = numerics.declared(integrator)
        _order(diagnosis, integrator, found, claim)
        _symplectic(diagnosis, integrator, found, claim)
        _reversible(diagnosis, integrator, found, claim)
        diagnosis.told.append(_told(diagnosis, integrator, found))
        if diagnosis.leads:
            _linear(diagnosis, integrator, found.stable_up_to)


def _told(diagnosis: Diagnosis, integrator: str, found: numerics.Identity) -> dict[str, Any]:
    """What the integrator is, as ``diagnose.json`` has it."""
    limit = found.stable_up_to
    return {
        "plant": diagnosis.subject.name,
        "integrator": integrator,
        "order": "exact to rounding" if found.order is None else round(found.order, 6),
        "symplectic": found.symplectic,
        "reversible": found.reversible,
        "stable_up_to_h_omega": round(limit, 6),
        "stable_up_to_dt_s": round(limit / diagnosis.subject.frequency, 6),
        "stable": _stable_words(limit, diagnosis.subject.frequency),
    }


def _stable_words(limit: float, frequency: float) -> str:
    if limit == 0.0:
        return "never: oscillations grow at every step"
    if math.isinf(limit):
        return "any step"
    return f"hω = {limit:.4g}, dt = {limit / frequency:.3g} s"


def _order(
    diagnosis: Diagnosis, integrator: str, found: numerics.Identity, claim: numerics.Declared
) -> None:
    if found.order is None:
        exact = Expectation("0: rounding", f"below {said(numerics.ROUNDING)} of the state", True)
        expectation = exact if integrator == TRUTH else undeclared("no error to measure it by")
    elif claim.order is None:
        expectation = undeclared()
    else:
        expectation = near(claim.order, numerics.ORDER_TOLERANCE, (found.order,))
    diagnosis.add(
        integrator, "order of convergence", (), "", expectation,
        order=found.order, order_steps=found.order_steps,
    )  # fmt: skip


def _symplectic(
    diagnosis: Diagnosis, integrator: str, found: numerics.Identity, claim: numerics.Declared
) -> None:
    defect = (found.symplecticity_defect,)
    claimed, yes, no = claim.symplectic, "symplectic", "not symplectic"
    if integrator == TRUTH:
        claimed, yes = True, "the exact motion is symplectic"
    elif claimed and not diagnosis.subject.plant.constant_mass_matrix:
        claimed, no = False, "not where M depends on q"
    diagnosis.add(
        integrator, "symplectic, max |JᵀΩJ − Ω| of one step", defect, "",
        _claimed(claimed, numerics.SYMPLECTIC, defect, "", yes, no), steps=(found.dt,),
    )  # fmt: skip


def _reversible(
    diagnosis: Diagnosis, integrator: str, found: numerics.Identity, claim: numerics.Declared
) -> None:
    plant = diagnosis.subject.plant
    worst = int(np.argmax(found.reversibility_errors))
    unit, error = state_units(plant)[worst], (found.reversibility_errors[worst],)
    claimed = integrator == TRUTH or claim.reversible
    diagnosis.add(
        integrator, f"reversible, forward, turn, back: worst of {', '.join(state_names(plant))}",
        error, unit,
        _claimed(claimed, numerics.REVERSIBLE, error, unit, "reversible", "not reversible"),
        steps=(found.dt,),
    )  # fmt: skip


def _claimed(
    claimed: bool | None, bound: float, defect: tuple[float], unit: str, yes: str, no: str
) -> Expectation:
    """A defect below a bound of what claims to have none, above it of what claims to have one."""
    if claimed is None:
        return undeclared()
    return below(bound, defect, unit, yes) if claimed else above(bound, defect, unit, no)


def _linear(diagnosis: Diagnosis, integrator: str, limit: float) -> None:
    """Once per integrator: what it does to a harmonic oscillator."""
    theory, claim = theory_of(integrator), numerics.declared(integrator)
    gain = (numerics.linear_map(integrator, Z).spectral_radius ** 2 - 1.0,)
    factor, bound = undeclared(), undeclared()
    if theory is not None:
        wanted = theory.energy_factor(Z) - 1.0
        factor = near(wanted, _FACTOR_TOLERANCE, gain, why=theory.formula)
        bound = near(theory.oscillation_limit, _LIMIT_TOLERANCE, (limit,))
    elif claim.symplectic:
        factor = near(0.0, _FACTOR_TOLERANCE, gain, why="declared symplectic")
    quantity = f"share of energy gained per step at hω = {Z:g}"
    diagnosis.add(integrator, quantity, gain, "", factor, plant=OSCILLATOR)
    diagnosis.add(integrator, "stable up to hω", (limit,), "", bound, plant=OSCILLATOR)


OSCILLATOR = "oscillator"
"""The linear test equation, which stands for no plant."""
