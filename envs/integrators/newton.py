"""Where within an inner step the accelerations of a system have a kink."""

from __future__ import annotations

import sys
from typing import Any, NamedTuple

from ..mechanics import Kink
from ..ops.ops import Component, Components, Ops, along, select
from .interface import System


def time_of_kink(
    ops: Ops,
    system: System,
    n: int,
    start: Components,
    end: Components,
    control: Component,
    h: Component,
) -> Component:
    """When to look for the first kink within an inner step of ``h`` seconds, or -1 without one.

    ``start`` and ``end`` begin with the ``n`` coordinates and their velocities.
    """
    before, after = (system.kinks(ops, y[:n], y[n : 2 * n], control) for y in (start, end))
    first, *others = [_time_of_one(ops, *pair, h) for pair in zip(before, after, strict=True)]
    for time in others:
        sooner = (time >= 0.0) & ((first < 0.0) | (time < first))
        first = ops.where(sooner, time, first)
    return first


def _time_of_one(ops: Ops, start: Kink, end: Kink, h: Component) -> Component:
    """Of one kink.

    Either the values at the ends differ in sign, and a line between them says when it vanished; or
    it turned back within the step and the tangents at its ends, which bound a convex value from
    below, meet beyond the kink. A value with a layer counts where the step goes beyond the layer,
    on either side; behind it all is another, so that the tangent at the start is asked as well.
    """
    if start.layer is None:
        return _time_of_crossing(ops, *start[:2], *end[:2], h)
    side = ops.where(start.value < 0.0, -1.0, 1.0)
    values = side * start.value, side * start.rate, side * end.value, side * end.rate
    beyond = ops.maximum(values[0], abs(end.value)) > ops.minimum(start.layer, end.layer)
    time, tangent = _time_of_crossing(ops, *values, h), values[0] / ops.maximum(-values[1], 1e-30)
    return ops.where(beyond, ops.minimum(time, tangent), -1.0)


def _time_of_crossing(
    ops: Ops,
    gap: Component,
    rate: Component,
    end_gap: Component,
    end_rate: Component,
    h: Component,
) -> Component:
    across = (gap > 0.0) != (end_gap > 0.0)
    share = abs(gap) / ops.maximum(abs(gap) + abs(end_gap), 1e-30)
    turning = (gap > 0.0) & (end_gap > 0.0) & (rate < 0.0) & (end_rate > 0.0)
    turn = (gap - end_gap + end_rate * h) / ops.where(turning, end_rate - rate, 1.0)
    grazing = turning & (gap + rate * turn < 0.0)
    return ops.where(across, share * h, ops.where(grazing, ops.minimum(turn, 0.5 * h), -1.0))


def solve_linear(ops: Ops, matrix: tuple[Components, ...], rhs: Components) -> Components:
    """Solve ``matrix @ x = rhs`` by elimination without pivoting.

    Made for the Newton matrices I - O(h) of a few degrees of freedom, whose leading entries stay
    away from zero. A vanishing pivot is replaced by one machine epsilon, so that the three worlds
    take the same path; the residual then tells.
    """
    pivot = ops.where(matrix[0][0] == 0.0, ops.epsilon, matrix[0][0])
    if len(rhs) == 1:
        return (rhs[0] / pivot,)
    rows, reduced = [], []
    for row, value in zip(matrix[1:], rhs[1:], strict=True):
        factor = row[0] / pivot
        rows.append(tuple(a - factor * b for a, b in zip(row[1:], matrix[0][1:], strict=True)))
        reduced.append(value - factor * rhs[0])
    rest = solve_linear(ops, tuple(rows), tuple(reduced))
    known = sum(a * x for a, x in zip(matrix[0][1:], rest, strict=True))
    return ((rhs[0] - known) / pivot, *rest)


TOLERANCE = 1e-10
"""Scaled residual max |F_i| / (1 + |V_i|) above which a solution is `not_converged` (float64)."""

CAP = 50
"""Most Newton iterations per step."""

_ROUNDING = 16.0
"""Residuals below this many machine epsilons cannot be improved."""

LEAST_TOLERANCE = 4.0 * _ROUNDING * sys.float_info.epsilon
"""Rounding leaves no smaller residual (float64)."""

_IMPROVEMENT = 0.5
"""Below the tolerance, an iteration that gains less than this factor is the last."""


class Solved:
    """What integrators say of this method that solve their equations by it: where it stops.

    At the default tolerance and below, iterations also go on while they help.

    Attributes:
        solver_tolerance: scaled residual above which a solution is `not_converged`.
        solver_cap: most Newton iterations per step.
    """

    solver_tolerance: float = TOLERANCE
    solver_cap: int = CAP


class Solution(NamedTuple):
    """Root of an equation with the solver's report."""

    v: Components
    iterations: Component
    residual: Component
    converged: Component


def solve(equation: Any, start: Components, method: Solved) -> Solution:
    """Solve F(V) = 0 by Newton's method, in velocities of all degrees of freedom and stages.

    ``equation`` has the arithmetic ``ops`` and the ``system``, ``defect(velocity)``, which gives F,
    and ``derivative(velocity, f)``, which gives the rows of ∂F/∂V where F is ``f``.

    In a steep system a correction after which the defect would be larger is halved, so that
    friction and stops do not throw the iteration from side to side.
    """
    ops, steep = equation.ops, equation.system.steep
    tolerance = max(method.solver_tolerance, 4.0 * _ROUNDING * ops.epsilon)
    n = len(start)

    def unfinished(carry: tuple[Component, ...]) -> Component:
        residual, previous, iterations = carry[2 * n : 2 * n + 3]
        improving = residual > tolerance
        if method.solver_tolerance <= TOLERANCE:
            improving = improving | (residual < _IMPROVEMENT * previous)
        unspent = iterations < method.solver_cap
        return (residual > _ROUNDING * ops.epsilon) & improving & unspent

    def newton(carry: tuple[Component, ...]) -> tuple[Component, ...]:
        velocity, f = carry[:n], carry[n : 2 * n]
        residual, previous, iterations, share, size = carry[2 * n :]
        correction = solve_linear(ops, equation.derivative(velocity, f), f)
        trial = tuple([x - share * y for x, y in zip(velocity, correction, strict=True)])
        moved = equation.defect(trial)
        now = _largest(ops, moved) if steep else size
        accepted = (*trial, *moved, _scale(ops, moved, trial), residual, iterations + 1, 1.0, now)
        if not steep:
            return accepted
        better = (now < size) | (residual <= tolerance)
        refused = (*velocity, *f, residual, previous, iterations + 1, 0.5 * share, size)
        return select(ops, better, accepted, refused)

    f = equation.defect(start)
    residual = _scale(ops, f, start)
    carry = (*start, *f, residual, 4.0 * residual + 1.0, 0, 1.0, _largest(ops, f))
    end = ops.while_loop(unfinished, newton, carry)
    return Solution(end[:n], end[2 * n + 2], end[2 * n], end[2 * n] <= tolerance)


class VelocityEquation(NamedTuple):
    """F(V) = V - v - kick · a(q + drift · V, V), with kick and drift in seconds.

    The Jacobian is the plant's, or a forward difference where the plant has none.
    """

    ops: Ops
    system: System
    q: Components
    v: Components
    control: Components
    kick: Component
    drift: Component

    def defect(self, velocity: Components) -> Components:
        position = along(self.q, self.drift, velocity)
        acceleration, _ = self.system.rates(self.ops, position, velocity, self.control)
        target = along(self.v, self.kick, acceleration)
        return tuple([x - y for x, y in zip(velocity, target, strict=True)])

    def derivative(self, velocity: Components, f: Components) -> tuple[Components, ...]:
        """Rows of ∂F/∂V at ``velocity``, where F is ``f``."""
        position = along(self.q, self.drift, velocity)
        slopes = self.system.slopes(self.ops, position, velocity, self.control)
        if slopes is None:
            return differences(self, velocity, f)
        by_q, by_v = slopes
        indices = range(len(velocity))
        return tuple(
            tuple(
                (1.0 if i == j else 0.0) - self.kick * (self.drift * by_q[i][j] + by_v[i][j])
                for j in indices
            )
            for i in indices
        )


def differences(equation: Any, velocity: Components, f: Components) -> tuple[Components, ...]:
    """Rows of ∂F/∂V at ``velocity``, where F is ``f``, by forward differences."""
    columns = []
    for j, x in enumerate(velocity):
        increment = equation.ops.epsilon**0.5 * (1.0 + abs(x))
        moved = equation.defect((*velocity[:j], x + increment, *velocity[j + 1 :]))
        columns.append([(b - a) / increment for a, b in zip(f, moved, strict=True)])
    return tuple(tuple(column[i] for column in columns) for i in range(len(velocity)))


def _largest(ops: Ops, f: Components) -> Component:
    largest = abs(f[0])
    for x in f[1:]:
        largest = ops.maximum(largest, abs(x))
    return largest


def _scale(ops: Ops, f: Components, velocity: Components) -> Component:
    return _largest(ops, tuple([x / (1.0 + abs(v)) for x, v in zip(f, velocity, strict=True)]))
