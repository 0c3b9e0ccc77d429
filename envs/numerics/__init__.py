"""Measurements of integrators and plants: what a discretization does, in numbers.

Each takes an integrator by name or as ``"module:Class"``, a plant with numbers as parameters and a
state in the order of ``env.unwrapped.state``.
"""

from .closed_loop import critical_step
from .convergence import Convergence, convergence
from .energy import EnergyGrowth, energies, energy_growth
from .identification import Declared, Identity, classify, declared
from .independent import IndependentMotion, independent_motion
from .ledger import Ledger, ledger
from .linear import LinearMap, linear_map, stability_limit
from .phase_space import canonical_jacobian, symplecticity_defect, volume_defect
from .probe import fastest_rate, probe_state
from .reversibility import reversibility_defect
from .stepping import advance

__all__ = [
    "Convergence",
    "Declared",
    "EnergyGrowth",
    "Identity",
    "IndependentMotion",
    "Ledger",
    "LinearMap",
    "advance",
    "canonical_jacobian",
    "classify",
    "convergence",
    "critical_step",
    "declared",
    "energies",
    "energy_growth",
    "fastest_rate",
    "independent_motion",
    "ledger",
    "linear_map",
    "probe_state",
    "reversibility_defect",
    "stability_limit",
    "symplecticity_defect",
    "volume_defect",
]
