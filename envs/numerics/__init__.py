"""Measurements of integrators and plants: what a discretization does, in numbers.

Order, symplecticity, reversibility, stability, energy and ledger, for built-in parts and for a
user's own. Knows plants and one-step maps; judges nothing.
"""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
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
else:
    __getattr__, __dir__ = lazy_door(__name__)
