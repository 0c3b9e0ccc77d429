"""A `Box` action as a control within symmetric limits."""

from __future__ import annotations

from ..arithmetic import Component, Ops
from .interface import Command

FLOAT32_ROUNDING = 1e-6
"""Actions arrive in float32, in which the bounds are rounded too."""


def saturated(ops: Ops, action: Component, limit: Component) -> Command:
    """``action`` within ±``limit``; one at the limit counts, as policies clip to it in float32."""
    valid = ops.usually(ops.isfinite(action))
    clipped = ops.maximum(-limit, ops.minimum(action, limit))
    at_limit = abs(action) >= limit * (1.0 - FLOAT32_ROUNDING)
    return Command(ops.where(valid, clipped, 0.0), valid, valid & at_limit)
