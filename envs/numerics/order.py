"""Order of convergence of an integrator on a plant."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..plants.interface import Plant
from .stepping import Advance, State, advance

HALVINGS = (4, 5, 6, 7, 8, 9)
"""Steps are duration / 2**k."""

ROUNDING = 1e-12
"""Errors below this share of the state's size measure the arithmetic, not the method."""


@dataclass(frozen=True)
class Convergence:
    """Errors after a fixed time over a ladder of steps.

    Attributes:
        steps_s: steps from coarse to fine, s.
        errors: Euclidean norm of the error in (q, v / frequency), per step.
        order: as :func:`slope` measures it.
    """

    steps_s: tuple[float, ...]
    errors: tuple[float, ...]
    order: float | None


def convergence(
    integrator: str,
    plant: Plant,
    state: State,
    duration_s: float = 0.5,
    truth: State | None = None,
    frequency: float = 1.0,
    control: float = 0.0,
    halvings: Sequence[int] = HALVINGS,
    follow: Advance = advance,
    rounding: float = ROUNDING,
) -> Convergence:
    """Measure the order on the motion from a state under a constant control.

    Args:
        integrator: a registered name or ``"module:Class"``.
        plant: with numbers as parameters.
        state: start, shape (n,), in state order.
        duration_s: length of the motion; a few radians of the fastest oscillation at most, else
            phase errors hide the slope.
        truth: the state at its end; None: by the ``reference`` integrator.
        frequency: ω in the norm (q, v / ω), rad/s.
        control: held throughout, in the plant's unit.
        halvings: exponents k of the steps duration / 2**k.
        follow: what takes the steps.
        rounding: share of the state's size below which an error measures the arithmetic.
    """
    if truth is None:
        truth = follow("reference", plant, state, duration_s, 1, control)
    exact = np.asarray(truth, dtype=np.float64)
    weights = np.tile([1.0, 1.0 / frequency], len(exact) // 2)
    steps = tuple(duration_s / 2**k for k in halvings)
    errors = tuple(
        float(
            np.linalg.norm(weights * (follow(integrator, plant, state, h, 2**k, control) - exact))
        )
        for k, h in zip(halvings, steps, strict=True)
    )
    floor = rounding * (1.0 + float(np.linalg.norm(weights * exact)))
    return Convergence(steps, errors, slope(steps, errors, floor))


def slope(steps: Sequence[float], errors: Sequence[float], floor: float) -> float | None:
    """d log error / d log step between the two finest steps whose errors are above ``floor``.

    Args:
        steps: from coarse to fine, s.
        errors: one per step; not finite where the motion diverged.
        floor: errors up to this are rounding.

    Returns:
        None where there are no two such steps: the method is exact to rounding; NaN where it
        diverges at the finest step.
    """
    if not math.isfinite(errors[-1]):
        return math.nan
    usable = [(h, e) for h, e in zip(steps, errors, strict=True) if floor < e < math.inf]
    if len(usable) < 2:
        return None
    (coarse, large), (fine, small) = usable[-2:]
    return float(np.log(large / small) / np.log(coarse / fine))
