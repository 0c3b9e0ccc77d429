"""What tasks with a `Box` action have in common."""

from __future__ import annotations

from typing import Any, ClassVar

from ..arithmetic.ops import Component, Components, Ops
from .interface import Command

FLOAT32_ROUNDING = 1e-6
"""Actions arrive in float32, in which the bounds are rounded too."""


def saturated(ops: Ops, action: Component, limit: Component) -> Command:
    """``action`` within ±``limit``; one at the limit counts, as policies clip to it in float32."""
    valid = ops.usually(ops.isfinite(action))
    clipped = ops.maximum(-limit, ops.minimum(action, limit))
    at_limit = abs(action) >= limit * (1.0 - FLOAT32_ROUNDING)
    return Command(ops.where(valid, clipped, 0.0), valid, valid & at_limit)


class BoxTask:
    """A control within symmetric limits, no end but by time, and no reward below 0."""

    discrete: ClassVar[int | None] = None
    control_limit: Any

    def command(self, ops: Ops, action: Component) -> Command:
        """The control, saturated."""
        return saturated(ops, action, self.control_limit)

    def worst_return(
        self, ops: Ops, remaining: Component, control_period: float, top_speed: Component
    ) -> Component:
        """No further reward."""
        return 0.0 * remaining

    def terminated(self, ops: Ops, q: Components, v: Components) -> Component:
        """Never."""
        return False
