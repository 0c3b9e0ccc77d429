"""One line of a diagnosis: what was measured, what theory expects, and whether it holds."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

from integ_gym.eval.report_data import compact

VERDICTS = {True: "yes", False: "NO", None: "-"}
"""What a table says of `holds`; None: nothing was expected."""


@dataclass(frozen=True)
class Finding:
    """One line.

    Attributes:
        section: part of the diagnosis.
        plant: the plant's name, or its reference.
        integrator: the integrator's name, or its reference.
        quantity: what was measured, in words.
        measured: numbers, coarse to fine where ``steps`` has several; or words.
        unit: SI unit of the numbers.
        expected: what theory says, in words.
        holds: whether it does; None where theory promises nothing.
        steps: integration steps that the numbers belong to, s.
    """

    section: str
    plant: str
    integrator: str
    quantity: str
    measured: tuple[float, ...] | str
    unit: str
    expected: str
    holds: bool | None
    steps: tuple[float, ...] = ()

    def words(self) -> str:
        """The measurement as shown in a table."""
        if isinstance(self.measured, str):
            return self.measured
        return f"{', '.join(shown(x) for x in self.measured)} {self.unit}".strip()

    def row(self) -> dict[str, Any]:
        """The line as JSON: numbers that are not finite are null."""
        measured = self.measured
        if not isinstance(measured, str):
            measured = [x if math.isfinite(x) else None for x in measured]  # type: ignore[assignment]
        return {**asdict(self), "measured": measured, "steps": list(self.steps)}


def shown(value: float) -> str:
    """A number with three significant digits; infinities in words."""
    if math.isinf(value):
        return "unbounded"
    return compact(value, 3)


def halving_order(errors: Sequence[float], steps: Sequence[float]) -> float:
    """Slope of log error over log step between the two finest steps; NaN where there is none."""
    if len(errors) < 2 or not min(errors[-2:]) > 0.0:
        return math.nan
    return math.log(errors[-2] / errors[-1]) / math.log(steps[-2] / steps[-1])
