"""What a panel is expected to take, in time and in memory, before it is begun.

Knows measured rates and the specification, not what was run.
"""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from .expected_cost import ExpectedCost, fixed_cost, policy_costs, total_cost
    from .expected_time import cell_seconds, cell_timing, check_cost, trying_seconds
else:
    __getattr__, __dir__ = lazy_door(__name__)
