"""Intervals and tests over training seeds, and over the episodes of one given policy.

Knows arrays of rates and returns, not what they are rates of.
"""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from .bounds import PROVEN, SHOWN, p_equivalent, share, worst_case_means
    from .episodes import draws_for, paired_return, paired_success
    from .family import holm
    from .interval import Floats, Interval, RatesLike, equal_tailed, mean_of, one_dimensional
    from .posterior import DRAWS, joint_means, paired_posterior, rate_posterior, unpaired_posterior
    from .ranking import pearson, rank_violation, ranking_intervals
    from .rates import Difference, mean_rate, paired_difference, rate_interval, unpaired_difference
    from .returns import iqm, iqm_interval
    from .scalars import mean_interval, median_interval, student_t_quantile
    from .streams import Stream
else:
    __getattr__, __dir__ = lazy_door(__name__)
