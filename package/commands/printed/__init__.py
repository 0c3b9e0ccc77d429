"""What ``integ-gym panel`` prints beside its page: the answer, the plan, the power, the verdicts.

Knows tables of terminals; the numbers are the panel's.
"""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from .answer import print_details, print_headline, print_next
    from .plan import print_plan
    from .power import print_power
    from .verdicts import print_verdicts
else:
    __getattr__, __dir__ = lazy_door(__name__)
