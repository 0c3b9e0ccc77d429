"""Bounds on all lanes that hold for certain where a sum of squares over them is small enough."""

from __future__ import annotations

import math
import sys
from typing import Any

from .symbols import Symbol

_ROOM = 0.5
"""Part of a squared bound that a rounded sum of squares may take up."""


def sums_of_squares(condition: Any) -> list[tuple[Symbol, float]] | None:
    """Numbers and what the sum of their squares over the lanes may be, for ``condition`` to hold.

    A sum that is larger, or not finite, says nothing.

    Returns:
        None where the condition is not made by ``and`` of bounds on magnitudes and ``isfinite``.
    """
    if not isinstance(condition, Symbol):
        return None
    if condition.template == "{0} & {1}":
        parts = [sums_of_squares(argument) for argument in condition.arguments]
        return None if None in parts else [bound for part in parts for bound in part or ()]
    if condition.template == "isfinite({0})":
        return [(condition.arguments[0], sys.float_info.max)]
    if condition.template == "{0} <= {1}":
        magnitude, bound = condition.arguments
        squared = _ROOM * bound * bound if isinstance(bound, float) and bound > 0.0 else math.inf
        if getattr(magnitude, "template", "") == "abs({0})" and squared < math.inf:
            return [(magnitude.arguments[0], squared)]
    return None
