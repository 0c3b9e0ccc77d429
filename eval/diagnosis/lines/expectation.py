"""What is expected of a measurement: in words, with its tolerance, and whether it holds."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from integ_gym.support.terminal import compact


@dataclass(frozen=True)
class Expectation:
    """One expectation.

    Attributes:
        expected: what is expected, with its unit and, where it is short, the reason.
        tolerance: how far off the measurement may be, with its unit.
        holds: whether it is within; None where nothing is expected.
    """

    expected: str
    tolerance: str
    holds: bool | None


NOTHING = "-"
"""Tolerance where nothing is expected, or where words alone decide."""


def near(
    wanted: float, tolerance: float, measured: Sequence[float], unit: str = "", why: str = ""
) -> Expectation:
    """Every number within a tolerance of one value, infinity included; NaN is not."""
    holds = all(x == wanted or abs(x - wanted) <= tolerance for x in measured)
    off = "exactly" if tolerance == 0.0 or math.isinf(wanted) else f"±{said(tolerance, unit)}"
    return Expectation(_because(said(wanted, unit), why), off, holds)


def below(
    bound: float, measured: Sequence[float], unit: str = "", why: str = "rounding"
) -> Expectation:
    """No number as large as a bound; NaN is."""
    holds = all(abs(x) < bound for x in measured)
    return Expectation(_because("0", why), f"below {said(bound, unit)}", holds)


def above(bound: float, measured: Sequence[float], unit: str = "", why: str = "") -> Expectation:
    """Every number above a bound; what diverged, and so is NaN, is."""
    holds = not any(x <= bound for x in measured)
    return Expectation(why, f"above {said(bound, unit)}", holds)


def undeclared(why: str = "not declared") -> Expectation:
    """Nothing is promised."""
    return Expectation(why, NOTHING, None)


def shown(value: float) -> str:
    """A number with three significant digits, a whole one as it is; infinity and NaN in words."""
    if math.isnan(value):
        return "diverged"
    if math.isinf(value):
        return "unbounded"
    whole = value == round(value) and abs(value) < 1e4
    return f"{value:z.0f}".replace("-", "−") if whole else compact(value, 3)


def said(value: float, unit: str = "") -> str:
    """A number that somebody chose, without trailing zeros, with its unit."""
    if not math.isfinite(value):
        return shown(value)
    mantissa, power, exponent = shown(value).partition("·")
    if "." in mantissa:
        mantissa = mantissa.rstrip("0").rstrip(".")
    number = exponent if power and mantissa == "1" else mantissa + power + exponent
    return f"{number} {unit}".strip()


def _because(expected: str, why: str) -> str:
    return f"{expected}: {why}" if why else expected
