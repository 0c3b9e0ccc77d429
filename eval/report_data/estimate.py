"""A number of ``panel.json`` with its interval."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from integ_gym.eval.formatting import finite, fixed


@dataclass(frozen=True)
class Estimate:
    """A number with its interval; the ends are None where the panel has none."""

    estimate: float
    low: float | None = None
    high: float | None = None
    level: float | None = None

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


def estimate(raw: Any) -> Estimate | None:
    """Read ``{"estimate", "low", "high", "level"}``; None without a finite estimate."""
    if not isinstance(raw, Mapping):
        return None
    middle = finite(raw.get("estimate"))
    if middle is None:
        return None
    low, high, level = (finite(raw.get(name)) for name in ("low", "high", "level"))
    return Estimate(middle, low, high, level)
