"""Outcomes at a limit, extrapolated from those of its three steps.

If halving the step at least halves the error, as in a method of order one or above, no more changes
beyond the finest step than in the last halving. That is all that is assumed of success, so its
interval is widened on either side by the share of episodes whose success still changes (bounds
without a model of what is not known: Manski 2003). Of returns the same holds, and where their
differences shrink they are extrapolated (Richardson 1911), with the order that is observed, at most
the integrator's (Roache 1998).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import msgspec
import numpy as np

from ..statistics import Estimate, Floats
from .result import Entry, Limit


@dataclass(frozen=True)
class AtLimit:
    """Outcomes of paired episodes at the limit, shapes (seeds, episodes).

    Attributes:
        success: 1 or 0, at the finest step.
        returns: extrapolated; at the finest step where an episode does not converge; NaN where one
            of the two finest steps has none that is finite.
        changed: whether an episode does not converge.
        changed_before: episodes whose success differs in the two coarser steps.
        success_slack: by how much mean success may be another on either side.
        return_slack: the same of the mean return.
    """

    success: Floats
    returns: Floats
    changed: np.ndarray[Any, np.dtype[np.bool_]]
    changed_before: int
    success_slack: float
    return_slack: float


def extrapolate(
    success: Sequence[Floats], returns: Sequence[Floats], order: int, close: float = np.inf
) -> AtLimit:
    """Outcomes at the limit from those at its steps, of which each is half the one before.

    Args:
        success: 1 or 0 at the three steps, each of shape (seeds, episodes).
        returns: at the three steps, likewise.
        order: of the integrator.
        close: a return that changes by more in the last halving does not converge.
    """
    first, last = returns[1] - returns[0], returns[2] - returns[1]
    flipped = success[1] != success[2]
    changed = flipped | ~(np.abs(last) <= close)
    with np.errstate(divide="ignore", invalid="ignore"):
        shrunk = np.minimum(first / last, 2.0**order)
        beyond = np.where(~changed & (shrunk >= 2.0), last / (shrunk - 1.0), 0.0)
    return AtLimit(
        success[2],
        np.where(np.isfinite(last), returns[2] + beyond, np.nan),
        changed,
        int((success[0] != success[1]).sum()),
        float(flipped.mean()),
        float(np.abs(last).mean()),
    )


def widen(value: Estimate | None, slack: float, low: float = -1.0, high: float = 1.0) -> Any:
    """An interval with a slack on either side, within bounds; None as it is."""
    if value is None or value.low is None or value.high is None:
        return value
    return msgspec.structs.replace(
        value, low=max(low, value.low - slack), high=min(high, value.high + slack)
    )


def entry_at_limit(entry: Entry, limit: Limit | None) -> Entry:
    """An entry of the limit's column, in which success, losses and return are at the limit.

    Args:
        entry: of any cell.
        limit: of its row, whose finest step its cell is; None: it is another cell.
    """
    if limit is None:
        return entry
    parts = ("home_drop", "difficulty", "deadline", "overfitting", "transfer_gap")
    return msgspec.structs.replace(
        entry,
        success=limit.success,
        returns=limit.returns,
        recovered=widen(entry.recovered, limit.success_slack, 0.0),
        **{name: widen(getattr(entry, name), limit.success_slack) for name in parts},
    )
