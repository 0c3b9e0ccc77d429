"""Axes of the page's drawings."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

from integ_gym.eval.panel_model import Estimate


@dataclass(frozen=True)
class Axis:
    """A horizontal axis whose positions are percentages of the drawing's width."""

    low: float
    high: float
    ticks: tuple[float, ...]

    def at(self, value: float) -> float:
        """Position of a value, cut to the axis, in percent with room for markers."""
        share = (min(max(value, self.low), self.high) - self.low) / (self.high - self.low)
        return round(2.0 + 96.0 * share, 2)

    def bar(self, value: Estimate) -> dict[str, float]:
        """Positions of an estimate and the ends of its interval."""
        low, high = value.ends
        return {"at": self.at(value.estimate), "low": self.at(low), "high": self.at(high)}


RATE_AXIS: Final = Axis(0.0, 1.0, (0.0, 0.25, 0.5, 0.75, 1.0))
"""Axis of success rates."""


def difference_axis(values: Iterable[Estimate], size: float = 0.2) -> Axis:
    """An axis for differences of rates that holds all of them and the margins of the verdicts."""
    ends = [end for value in values for end in (value.estimate, *value.ends)]
    low = math.floor(min([-0.2, *ends]) * 5.0 - 1e-9) / 5.0
    high = math.ceil(max([0.4, *ends]) * 5.0 + 1e-9) / 5.0
    low, high = max(low, -1.0), min(high, 1.0)
    size = size if high - low <= 1.6 else 0.5
    first, last = math.ceil(low / size - 1e-9), math.floor(high / size + 1e-9)
    return Axis(low, high, tuple(round(size * k, 2) for k in range(first, last + 1)))
