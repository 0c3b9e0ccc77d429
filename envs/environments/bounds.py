"""Controls at the bounds of what actuators can do."""

from __future__ import annotations

import numpy as np

from ..tasks._box import FLOAT32_ROUNDING
from .lanes import Array


def at_bounds(control: Array, low: Array, high: Array) -> bool:
    """Whether some control is at a bound or beyond it, as where a policy clips to it in float32.

    Args:
        control: asked for, any shape.
        low: least of each, infinite without a bound.
        high: most of each.
    """
    below = low + FLOAT32_ROUNDING * _finite(low)
    above = high - FLOAT32_ROUNDING * _finite(high)
    return bool(((control <= below) | (control >= above)).any())


def _finite(bound: Array) -> Array:
    return np.where(np.isfinite(bound), np.abs(bound), 0.0)
