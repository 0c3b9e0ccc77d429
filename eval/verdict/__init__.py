"""Verdicts: which wins are physics and which are simulator artefacts.

Three questions, each answered by a function that takes success rates per training seed:

- `judge_family`: does a policy keep its success in another discretization?
- `reference_class`: does a discretization's pass or fail agree with the reference?
- `compare_policies`: does "policy A beats policy B" survive refinement of the step?
"""

from .comparison import CellFinding, CellRole, PolicyCell, PolicyComparison, compare_policies
from .family import Comparison, Judgement, judge_family, loss_of
from .reference import ReferenceClass, reference_class
from .rules import (
    ALPHA,
    EQUIVALENCE_MARGIN,
    FAIL_MARGIN,
    LEARNED,
    MIN_SEEDS,
    PASS,
    UNSOLVED,
    p_text,
)

__all__ = [
    "ALPHA",
    "EQUIVALENCE_MARGIN",
    "FAIL_MARGIN",
    "LEARNED",
    "MIN_SEEDS",
    "PASS",
    "UNSOLVED",
    "CellFinding",
    "CellRole",
    "Comparison",
    "Judgement",
    "PolicyCell",
    "PolicyComparison",
    "ReferenceClass",
    "compare_policies",
    "judge_family",
    "loss_of",
    "p_text",
    "reference_class",
]
