"""Horizontal axes of success rates and of their differences."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

from integ_gym.support.terminal import fixed

from ...panel.model.part import Estimate

_FEW: Final = 5
"""Ticks that a narrow axis has room for."""


@dataclass(frozen=True)
class Axis:
    """A horizontal axis.

    Attributes:
        low, high: its ends.
        ticks: values, and how they are written.
        margins: whether the margins of the verdicts are drawn.
    """

    low: float
    high: float
    ticks: tuple[tuple[float, str], ...]
    margins: bool = False

    @property
    def between(self) -> frozenset[int]:
        """Places of ticks that are left out where an axis is narrow; zero stays."""
        zero = min(range(len(self.ticks)), key=lambda k: abs(self.ticks[k][0]))
        few = len(self.ticks) <= _FEW
        return frozenset() if few else frozenset(range(1 - zero % 2, len(self.ticks), 2))

    def share(self, value: float) -> float:
        """Place of a value, cut to the axis, in [0, 1] of the width with room for markers."""
        inside = (min(max(value, self.low), self.high) - self.low) / (self.high - self.low)
        return 0.02 + 0.96 * inside


RATE_AXIS: Final = Axis(0.0, 1.0, tuple((0.25 * k, fixed(0.25 * k)) for k in range(5)))
"""Axis of success rates."""


def difference_axis(values: Iterable[Estimate], size: float = 0.2, margins: bool = False) -> Axis:
    """An axis for differences of rates that holds all of them and the margins of the verdicts."""
    ends = [end for value in values for end in (value.estimate, *value.ends)]
    low = math.floor(min([-0.2, *ends]) * 5.0 + 1e-9) / 5.0
    high = math.ceil(max([0.4, *ends]) * 5.0 - 1e-9) / 5.0
    low, high = max(low, -1.0), min(high, 1.0)
    size = size if high - low <= 1.6 else 0.5
    first, last = math.ceil(low / size - 1e-9), math.floor(high / size + 1e-9)
    ticks = [round(size * k, 2) for k in range(first, last + 1)]
    return Axis(low, high, tuple((tick, fixed(tick, 1)) for tick in ticks), margins)


def value_axis(values: Iterable[Estimate]) -> Axis:
    """An axis for differences of any unit that holds all of them and zero, with five ticks or so.

    Its ticks are multiples of 1, 2 or 5 times a power of ten.
    """
    ends = [end for value in values for end in (value.estimate, *value.ends)]
    low, high = min([0.0, *ends]), max([0.0, *ends])
    wanted = (high - low) / 5.0 or 1.0
    power = 10.0 ** math.floor(math.log10(wanted))
    size = next(power * step for step in (1.0, 2.0, 5.0, 10.0) if power * step >= wanted - 1e-12)
    first, last = min(math.floor(low / size), -1), max(math.ceil(high / size), 1)
    digits = max(0, -math.floor(math.log10(size)))
    ticks = tuple((size * k, fixed(size * k, digits)) for k in range(first, last + 1))
    return Axis(size * first, size * last, ticks)
