"""What is known of a discretization and a task before anything is trained.

Knows the numerics of environments, and no outcome.
"""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from .limits import control_argument, critical_limit, middle_start, setup_of
    from .quantities import Quantities
    from .terms import CANDIDATES, GUESSES, Term, terms_of
else:
    __getattr__, __dir__ = lazy_door(__name__)
