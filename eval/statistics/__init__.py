"""Intervals and tests over training seeds.

The unit of replication is the training seed: two episodes of one policy are not two
experiments. Every function here takes one number per seed (or one row per seed) and says how
far the seeds at hand speak for the seeds that were not run.

Success rates get their own method, because a handful of seeds that all succeed, or that either
succeed or fail outright, defeats the usual ones: a percentile bootstrap of three perfect seeds
is [1, 1], and the interquartile mean drops the two failures in eight that were looked for. The
posterior used instead is a Dirichlet process with a prior of total weight one. For a rate the
prior lays one half at 0 and one half at 1; each seed then weighs as much as the whole prior.

Monte Carlo generators are seeded by constants of this package and the data are sorted first, so
the same seeds in any order give the same numbers on the same NumPy build. With ``DRAWS`` draws
a p-value near 0.05 carries a standard error of 0.0005.

References
----------
Ferguson, T. S. (1973). A Bayesian analysis of some nonparametric problems. Annals of
Statistics 1(2), 209-230.
Rubin, D. B. (1981). The Bayesian bootstrap. Annals of Statistics 9(1), 130-134.
Brown, L. D., Cai, T. T. and DasGupta, A. (2001). Interval estimation for a binomial
proportion. Statistical Science 16(2), 101-133.
Holm, S. (1979). A simple sequentially rejective multiple test procedure. Scandinavian Journal
of Statistics 6(2), 65-70.
Agarwal, R. et al. (2021). Deep reinforcement learning at the edge of the statistical
precipice. NeurIPS 34.
"""

from .family import holm
from .interval import Floats, Interval, RatesLike
from .posterior import DRAWS, paired_posterior, rate_posterior, unpaired_posterior
from .rates import Difference, mean_rate, paired_difference, rate_interval, unpaired_difference
from .returns import BOOTSTRAP_DRAWS, iqm, iqm_interval
from .scalars import mean_interval, median_interval, student_t_quantile

__all__ = [
    "BOOTSTRAP_DRAWS",
    "DRAWS",
    "Difference",
    "Floats",
    "Interval",
    "RatesLike",
    "holm",
    "iqm",
    "iqm_interval",
    "mean_interval",
    "mean_rate",
    "median_interval",
    "paired_difference",
    "paired_posterior",
    "rate_interval",
    "rate_posterior",
    "student_t_quantile",
    "unpaired_difference",
    "unpaired_posterior",
]
