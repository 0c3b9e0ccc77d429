"""What a step really is: an integrator's properties, the known map it equals, a fingerprint."""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
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
    from .matching import Case, cases_of, largest_error, mapped, match
else:
    __getattr__, __dir__ = lazy_door(__name__)
