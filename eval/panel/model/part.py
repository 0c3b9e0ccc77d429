"""What every part of the model is, and a number with its interval."""

from __future__ import annotations

import math
from typing import Any, TypeVar

import msgspec

from integ_gym.support.terminal import fixed

from ...statistics import Interval


class Part(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A part of a panel: immutable, and of a file it must say all that is asked for, no more."""


PartType = TypeVar("PartType", bound=Part)


def build(part: type[PartType], /, **values: Any) -> PartType:
    """A part from values that are checked; a result of the statistics becomes a part of its own.

    Raises:
        msgspec.ValidationError: if a value is of another type than the part asks for.
    """
    return msgspec.convert(values, part, from_attributes=True)


class Estimate(Part, frozen=True):
    """A number with a two-sided interval over training seeds, in the unit of what it estimates.

    Where a policy was given, the interval is over its episodes: this policy, these starts.

    Attributes:
        estimate: the number.
        low: lower end of the interval; null where there is none or it is not bounded.
        high: upper end of the interval; null as the lower.
        level: nominal coverage of the interval, in (0, 1); null without one.
    """

    estimate: float
    low: float | None = None
    high: float | None = None
    level: float | None = None

    @classmethod
    def of(cls, interval: Interval) -> Estimate:
        """An interval of the statistics; ends that are not finite are not known."""
        low, high = (end if math.isfinite(end) else None for end in (interval.low, interval.high))
        return cls(interval.estimate, low, high, interval.level)

    @property
    def bounded(self) -> bool:
        """Whether both ends are known."""
        return self.low is not None and self.high is not None

    @property
    def ends(self) -> tuple[float, float]:
        """Both ends; the estimate itself where an end is unknown."""
        return (
            self.estimate if self.low is None else self.low,
            self.estimate if self.high is None else self.high,
        )

    def __str__(self) -> str:
        if not self.bounded:
            return fixed(self.estimate)
        return f"{fixed(self.estimate)} ({fixed(self.low)} to {fixed(self.high)})"
