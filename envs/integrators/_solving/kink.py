"""Where within an inner step the accelerations of a system have a kink."""

from __future__ import annotations

from ...arithmetic.ops import Component, Components, Ops
from ..interface import System


def time_of_kink(
    ops: Ops, system: System, n: int, start: Components, end: Components, h: Component
) -> Component:
    """When to look for a kink within an inner step of ``h`` seconds, or -1 where there is none.

    ``start`` and ``end`` begin with the ``n`` coordinates and their velocities. Either the
    clearances there differ in sign, and a line between them says when it vanished; or the body
    turned back within the step and the tangents at its ends, which bound a convex clearance from
    below, meet beyond the kink.
    """
    gap, rate = system.clearance(ops, start[:n], start[n : 2 * n])
    end_gap, end_rate = system.clearance(ops, end[:n], end[n : 2 * n])
    across = (gap > 0.0) != (end_gap > 0.0)
    share = abs(gap) / ops.maximum(abs(gap) + abs(end_gap), 1e-30)
    turning = (gap > 0.0) & (end_gap > 0.0) & (rate < 0.0) & (end_rate > 0.0)
    turn = (gap - end_gap + end_rate * h) / ops.where(turning, end_rate - rate, 1.0)
    grazing = turning & (gap + rate * turn < 0.0)
    return ops.where(across, share * h, ops.where(grazing, ops.minimum(turn, 0.5 * h), -1.0))
