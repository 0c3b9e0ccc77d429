"""What an integrator's declared order promises of an error over a ladder of steps."""

from __future__ import annotations

from collections.abc import Sequence

from integ_gym.envs.numerics import declared
from integ_gym.eval.diagnosis.finding import halving_order
from integ_gym.eval.diagnosis.subject import Subject

SMALL = 0.1
"""hω of the finest step up to which the order shows; coarser ladders need only fall."""

SLACK = 0.35
"""How far below the order the slope may be: the steps of a ladder are not yet small.
:mod:`integ_gym.envs.numerics.convergence` measures the order itself."""


def promised(
    subject: Subject, integrator: str, errors: Sequence[float], rounding: float
) -> tuple[str, bool | None]:
    """What is expected of errors over the subject's steps, in words, and whether it holds.

    Args:
        subject: the plant.
        integrator: a registered name or ``"module:Class"``.
        errors: one per step, coarse to fine.
        rounding: an error below this counts as none.
    """
    order = declared(integrator).order
    slope = halving_order(errors, subject.steps)
    if order is None:
        return f"order not declared; measured dt^{slope:.2f}", None
    if subject.steps[-1] * subject.frequency > SMALL:
        return "falls with dt", errors[-1] < max(min(errors[:-1]), rounding)
    holds = slope > order - SLACK or errors[-1] < rounding
    return f"falls as dt^{order} or faster; measured dt^{slope:.2f}", bool(holds)
