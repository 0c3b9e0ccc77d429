"""Measurements of integrators and plants: what a discretization does, in numbers.

Order, symplecticity, reversibility, stability, energy and ledger, for built-in parts and for a
user's own. Knows plants and one-step maps; judges nothing.
"""

from .accuracy import ROUNDING as ROUNDING
from .accuracy import Convergence as Convergence
from .accuracy import IndependentMotion as IndependentMotion
from .accuracy import convergence as convergence
from .accuracy import independent_motion as independent_motion
from .accuracy import reversibility_errors as reversibility_errors
from .accuracy import slope as slope
from .accuracy import symplecticity_defect as symplecticity_defect
from .accuracy import volume_defect as volume_defect
from .energy import BOUNDED as BOUNDED
from .energy import METHOD as METHOD
from .energy import Reach as Reach
from .energy import critical_limit as critical_limit
from .energy import energies as energies
from .energy import energy_at as energy_at
from .energy import energy_growth as energy_growth
from .energy import goal_energy as goal_energy
from .energy import ledger as ledger
from .energy import reach as reach
from .identity import DAMPING as DAMPING
from .identity import IDENTICAL as IDENTICAL
from .identity import ORDER_TOLERANCE as ORDER_TOLERANCE
from .identity import REVERSIBLE as REVERSIBLE
from .identity import SYMPLECTIC as SYMPLECTIC
from .identity import Case as Case
from .identity import Declared as Declared
from .identity import Fingerprint as Fingerprint
from .identity import Identity as Identity
from .identity import cases_of as cases_of
from .identity import classify as classify
from .identity import damping_parameters as damping_parameters
from .identity import declared as declared
from .identity import fingerprint as fingerprint
from .identity import largest_error as largest_error
from .identity import mapped as mapped
from .identity import match as match
from .stepping import Advance as Advance
from .stepping import OneStep as OneStep
from .stepping import advance as advance
from .stepping import advance_lanes as advance_lanes
from .stepping import critical_step as critical_step
from .stepping import engine_of as engine_of
from .stepping import fastest_mode as fastest_mode
from .stepping import fastest_rate as fastest_rate
from .stepping import jacobian as jacobian
from .stepping import linear_map as linear_map
from .stepping import linear_rates as linear_rates
from .stepping import one_step as one_step
from .stepping import probe_state as probe_state
from .stepping import stability_limit as stability_limit

_MODULES = ("accuracy", "energy", "identity", "stepping")

__all__ = sorted(name for name in globals() if not name.startswith("_") and name not in _MODULES)
