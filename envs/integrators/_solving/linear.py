"""Small dense linear systems over components."""

from __future__ import annotations

from ...arithmetic.ops import Components, Ops


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
