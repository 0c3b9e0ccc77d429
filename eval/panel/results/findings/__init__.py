"""What a panel's records say: remedies, rankings, pairs, engines that agree, costs, maps.

Knows the matrix and the layout of one panel; the declared family is judged in `verdict`.
"""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from .applied import applied_in
    from .engine_agreement import agreements
    from .paired import paired_episodes
    from .ranking import rankings
    from .remedy import remedies
    from .training_cost import training_costs
else:
    __getattr__, __dir__ = lazy_door(__name__)
