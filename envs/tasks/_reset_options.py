"""Reading of Gymnasium's reset options."""

from __future__ import annotations

from collections.abc import Mapping
from math import isfinite
from typing import Any

from ..arithmetic.ops import Components


def number(options: Mapping[str, Any], name: str, default: float) -> float:
    """Option ``name`` as a float.

    Raises:
        ValueError: if it is not a number.
    """
    value = options.get(name, default)
    try:
        return float(value)
    except (TypeError, ValueError, OverflowError) as error:
        raise ValueError(f"reset option `{name}` must be a number, got {value!r:.60}") from error


def uniform(rng: Any, options: Mapping[str, Any], size: int, half_width: float) -> Components:
    """``size`` numbers uniform between the options ``low`` and ``high``.

    Args:
        rng: a ``numpy.random.Generator``, or what stands for it.
        options: reset options; without bounds ±``half_width``.

    Raises:
        ValueError: if the bounds are not finite and in order.
    """
    low, high = number(options, "low", -half_width), number(options, "high", half_width)
    if not (isfinite(high - low) and low <= high):
        raise ValueError(f"reset option `low`={low} must be finite and at most `high`={high}")
    return tuple(rng.uniform(low=low, high=high, size=(size,)))
