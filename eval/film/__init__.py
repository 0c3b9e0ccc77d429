"""Films: one policy in several discretizations, side by side, with its energy's ledger.

Knows policies and records, not what they are judged to be.
"""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from .film import LEAST_START, Film
    from .of_policy import side_by_side
    from .of_record import candidates, watch
    from .window import show_film
    from .writing import check_writable
else:
    __getattr__, __dir__ = lazy_door(__name__)
