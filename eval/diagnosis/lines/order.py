"""Lines on errors that should fall with the step at the integrator's declared order."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from integ_gym.envs import numerics
from integ_gym.envs.registries import TRUTH

from ..section import Diagnosis
from .expectation import Expectation, below, undeclared

TOLERANCE = 0.1
"""A measured order this far off is another one."""

EXACT = 1e-9
"""Errors of the exact motion are below this share of the scale."""


def order_line(
    diagnosis: Diagnosis,
    integrator: str,
    quantity: str,
    errors: Mapping[float, float],
    unit: str,
    scale: float,
    exact: str = "rounding",
    rounding: float = numerics.ROUNDING,
    **how: Any,
) -> None:
    """Add a line: errors at the subject's own steps, and the order over all steps.

    Args:
        diagnosis: gets the line.
        integrator: a registered name or ``"module:Class"``.
        quantity: what was measured, in words.
        errors: by step in s; not finite where the motion diverged.
        unit: SI unit of the errors.
        scale: size of what is off, in the same unit: it says what rounding is.
        exact: why the exact motion has no error.
        rounding: share of the scale below which an error says nothing of the method.
        how: `exactly` and `at_most` of :func:`order_expected`.
    """
    steps = tuple(sorted(errors, reverse=True))
    own = tuple(step for step in steps if step in diagnosis.subject.steps) or steps
    measured = tuple(errors[step] for step in own)
    add = (integrator, quantity, measured, unit)
    if integrator == TRUTH:
        diagnosis.add(*add, below(EXACT * scale, measured, unit, exact), steps=own)
        return
    order = numerics.slope(steps, tuple(errors[step] for step in steps), rounding * scale)
    expectation = order_expected(numerics.declared(integrator).order, order, **how)
    if expectation.holds and not all(map(math.isfinite, measured)):
        expectation = Expectation(expectation.expected, expectation.tolerance, False)
    diagnosis.add(*add, expectation, steps=own, order=order, order_steps=steps)


def order_expected(
    promised: int | None,
    measured: float | None,
    exactly: bool = False,
    at_most: tuple[int, str] | None = None,
) -> Expectation:
    """Whether a measured order is the promised one.

    Args:
        promised: the declared order, or None.
        measured: the slope; None: there is nothing but rounding; NaN: the motion diverged.
        exactly: whether a higher order than promised counts as wrong, too. Energies often converge
            faster than motions.
        at_most: largest order that the motion allows, and why.
    """
    if promised is None:
        return undeclared()
    wanted, why = promised, ""
    if at_most is not None and at_most[0] < promised:
        wanted, why = at_most[0], f": {at_most[1]}"
    if measured is None:
        return undeclared(f"order {wanted}; nothing but rounding at these steps")
    if exactly:
        return Expectation(f"order {wanted}", f"±{TOLERANCE}", abs(measured - wanted) <= TOLERANCE)
    least = wanted - TOLERANCE
    return Expectation(f"order {wanted} or more{why}", f"down to {least:g}", measured >= least)
