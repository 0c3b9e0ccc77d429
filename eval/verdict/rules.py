"""Margins and levels that verdicts are given at."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Final

FAIL_MARGIN: Final = 0.2
"""Overfitting shown to be larger than this is a failure to transfer."""

EQUIVALENCE_MARGIN: Final = 0.1
"""Overfitting shown to be smaller than this, in either direction, is a transfer."""

ALPHA: Final = 0.05
"""Significance level of every test here."""

MIN_SEEDS: Final = 5
"""Training seeds in either group below which nothing is concluded."""

PASS: Final = 0.5
"""Success rate from which on a row passes in a cell."""

LEARNED: Final = 0.5
"""Mean home success below which a policy counts as not learned."""

ACHIEVED: Final = 0.5
"""Share of the starts from which success shows that a cell can be solved."""

TAIL: Final = 0.5
"""A seed that loses more success than this is counted beside the mean."""

UNSOLVED: Final = 0.05
"""Mean success below which a policy counts as not solving a cell."""


def p_text(value: float) -> str:
    """A p-value in words."""
    if value < 0.001:
        return "p < 0.001"
    close = abs(value - ALPHA) < 0.1 * ALPHA
    return f"p = {value:.4f}" if close else f"p = {value:.3f}"


def require_unique(names: Sequence[str], kind: str) -> None:
    """Refuse names of which one occurs more than once."""
    twice = [name for name, count in Counter(names).items() if count > 1]
    if twice:
        raise ValueError(f"expected {kind} names that differ, got {twice[0]!r} more than once")
