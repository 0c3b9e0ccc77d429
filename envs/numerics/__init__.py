"""Measurements of integrators and plants: what a discretization does, in numbers.

Order, symplecticity, reversibility, stability, energy and ledger, for built-in parts and for a
user's own. Knows plants and one-step maps; judges nothing.
"""

from .energy import BOUNDED, energies, energy_growth, ledger
from .energy_reach import METHOD, Reach, critical_limit, energy_at, goal_energy, reach
from .fingerprinting import DAMPING, IDENTICAL, Fingerprint, damping_parameters, fingerprint
from .identity import (
    ORDER_TOLERANCE,
    REVERSIBLE,
    SYMPLECTIC,
    Declared,
    Identity,
    classify,
    declared,
)
from .independent import IndependentMotion, independent_motion
from .linear import critical_step, linear_map, stability_limit
from .matching import Case, cases_of, largest_error, mapped, match
from .order import ROUNDING, Convergence, convergence, slope
from .phase_space import reversibility_errors, symplecticity_defect, volume_defect
from .probe import fastest_mode, fastest_rate, linear_rates, probe_state
from .stepping import Advance, OneStep, advance, advance_lanes, engine_of, jacobian, one_step

__all__ = [
    "BOUNDED",
    "DAMPING",
    "IDENTICAL",
    "METHOD",
    "ORDER_TOLERANCE",
    "REVERSIBLE",
    "ROUNDING",
    "SYMPLECTIC",
    "Advance",
    "Case",
    "Convergence",
    "Declared",
    "Fingerprint",
    "Identity",
    "IndependentMotion",
    "OneStep",
    "Reach",
    "advance",
    "advance_lanes",
    "cases_of",
    "classify",
    "convergence",
    "critical_limit",
    "critical_step",
    "damping_parameters",
    "declared",
    "energies",
    "energy_at",
    "energy_growth",
    "engine_of",
    "fastest_mode",
    "fastest_rate",
    "fingerprint",
    "goal_energy",
    "independent_motion",
    "jacobian",
    "largest_error",
    "ledger",
    "linear_map",
    "linear_rates",
    "mapped",
    "match",
    "one_step",
    "probe_state",
    "reach",
    "reversibility_errors",
    "slope",
    "stability_limit",
    "symplecticity_defect",
    "volume_defect",
]
