"""Numbers as pages, figures and terminals print them."""

from __future__ import annotations

import math
import re
from typing import Final

NONE: Final = "–"
"""Shown where the panel has no value."""

_SUPERSCRIPT: Final = str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")


def fixed(value: float | None, digits: int = 2, sign: bool = False) -> str:
    """A number with a fixed count of decimals and a true minus sign."""
    if value is None or not math.isfinite(value):
        return NONE
    plus = "+" if sign and round(value, digits) > 0.0 else ""
    return plus + f"{value:z.{digits}f}".replace("-", "−")


def compact(value: float | None, digits: int = 2, sign: bool = False) -> str:
    """A number with a few significant digits, in powers of ten where it is large or small."""
    if value is None or not math.isfinite(value):
        return NONE
    plus = "+" if sign and value > 0.0 else ""
    value = float(f"{value:.{digits - 1}e}")
    if value == 0.0 or 1e-3 <= abs(value) < 1e4:
        decimals = max(0, digits - 1 - math.floor(math.log10(abs(value)))) if value else 0
        return plus + f"{value:z.{decimals}f}".replace("-", "−")
    mantissa, _, exponent = f"{value:.{digits - 1}e}".partition("e")
    power = str(int(exponent)).translate(_SUPERSCRIPT)
    return f"{plus}{mantissa}·10{power}".replace("-", "−")


def percent(share: float | None, digits: int = 0, sign: bool = False) -> str:
    """A share in per cent, such as ``54 %``."""
    return _in_percent(fixed(None if share is None else 100.0 * share, digits, sign))


def compact_percent(share: float | None, digits: int = 2, sign: bool = False) -> str:
    """The same with a few significant digits, such as ``3.8·10⁻⁶ %``."""
    return _in_percent(compact(None if share is None else 100.0 * share, digits, sign))


def _in_percent(text: str) -> str:
    return text if text == NONE else f"{text} %"


def together(text: str) -> str:
    """A sentence in which no line begins with the sign of a per cent."""
    return re.sub(r"(?<=\d) (?=%)", "\N{NO-BREAK SPACE}", text)


def true_minus(text: str) -> str:
    """A sentence with true minus signs before its numbers."""
    return re.sub(r"(?<=[ (])-(?=\d)", "−", text)


def seconds(value: float | None) -> str:
    """A duration in the units a person would say it in."""
    if value is None:
        return NONE
    if value < 60.0:
        return f"{value:.3g} s"
    minutes, rest = divmod(round(value), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes} min" if hours else f"{minutes} min {rest} s"


def step(value: float | None) -> str:
    """A step size in seconds, without a unit."""
    return NONE if value is None else f"{value:.6g}"


def plural(count: int, noun: str, more: str | None = None) -> str:
    """``1 cell``, ``2 cells``."""
    return f"{count:,} {noun if count == 1 else more or noun + 's'}"
