"""Measurements of integrators and plants: what a discretization does, in numbers.

Each takes an integrator by name or as ``"module:Class"``, a plant with numbers as parameters and a
state in the order of ``env.unwrapped.state``.
"""

from integ_gym.envs.numerics.closed_loop import critical_step
from integ_gym.envs.numerics.convergence import Convergence, convergence
from integ_gym.envs.numerics.energy import EnergyGrowth, energies, energy_growth
from integ_gym.envs.numerics.identity import Declared, Identity, classify, declared
from integ_gym.envs.numerics.independent import IndependentMotion, independent_motion
from integ_gym.envs.numerics.ledger import Ledger, ledger
from integ_gym.envs.numerics.linear import LinearMap, linear_map, stability_limit
from integ_gym.envs.numerics.phase_space import (
    canonical_jacobian,
    symplecticity_defect,
    volume_defect,
)
from integ_gym.envs.numerics.probe import fastest_rate, probe_state
from integ_gym.envs.numerics.reversibility import reversibility_defect
from integ_gym.envs.numerics.stepping import advance

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
