"""Verdicts: which wins are physics and which are simulator artefacts.

Knows the rules and their margins; the numbers are the statistics'.
"""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from .achievability import UNSOLVABLE, Achievability, Achieved, Attempt, Search, achieved
    from .comparison import (
        CellFinding,
        CellRole,
        CellStatus,
        Outcome,
        PolicyCell,
        PolicyComparison,
        compare_policies,
    )
    from .family import WITHOUT_VERDICT, Comparison, Judgement, Verdict, judge_family, postponed
    from .looks import Shares, adjust_for_look, share_of_look, shares_of
    from .loss import Loss, Rates, split
    from .power import Power, fewest_seeds, seeds_wanted, verdict_chances
    from .reference import ReferenceClass, reference_class
    from .rules import (
        ACHIEVED,
        ALPHA,
        EQUIVALENCE_MARGIN,
        FAIL_MARGIN,
        LEARNED,
        MIN_SEEDS,
        MIN_SEEDS_EQUIVALENCE,
        PASS,
        TAIL,
        UNSOLVED,
        p_text,
        require_unique,
    )
else:
    __getattr__, __dir__ = lazy_door(__name__)
