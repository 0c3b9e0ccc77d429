"""One line of a diagnosis: what was measured, what is expected, and whether it holds."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

from .expectation import Expectation, shown

VERDICTS = {True: "yes", False: "NO", None: "-"}
"""What a table says of `holds`; None: nothing was expected."""


@dataclass(frozen=True)
class Finding:
    """One line.

    Attributes:
        section: part of the diagnosis.
        plant: the plant's name, or its reference.
        integrator: the integrator's name, or its reference; :data:`ANY` where none takes part.
        quantity: what was measured, in words.
        measured: numbers, coarse to fine where ``steps`` has several; NaN: the motion diverged,
            ``inf``: there is no limit.
        unit: SI unit of the numbers.
        expectation: what is expected, the tolerance, and whether it holds.
        steps: integration steps that the numbers belong to, s.
        order: measured order of the numbers in the step, where one was measured; None also where
            there is nothing but rounding, NaN where the motion diverged.
        order_steps: integration steps over which the order was measured, s.
    """

    section: str
    plant: str
    integrator: str
    quantity: str
    measured: tuple[float, ...]
    unit: str
    expectation: Expectation
    steps: tuple[float, ...] = ()
    order: float | None = None
    order_steps: tuple[float, ...] = ()

    @property
    def holds(self) -> bool | None:
        """Whether what is expected holds; None where nothing is."""
        holds = self.expectation.holds
        return None if holds is None else bool(holds)

    def words(self) -> str:
        """The measurement as shown in a table."""
        numbers = ", ".join(map(shown, self.measured))
        unit = f" {self.unit}" if self.unit and any(map(math.isfinite, self.measured)) else ""
        return "; ".join(filter(None, (numbers + unit, self._order_words())))

    def row(self) -> dict[str, Any]:
        """The line as a table's row; ``shown`` says which numbers are not finite."""
        fields = asdict(self)
        expectation = fields.pop("expectation")
        return {**fields, **expectation, "holds": self.holds, "shown": self.words()}

    def _order_words(self) -> str:
        if not self.order_steps:
            return ""
        if self.order is None:
            return "rounding"
        return f"order {self.order:.2f}" if math.isfinite(self.order) else "diverges"


ANY = "-"
"""Integrator of a line in which none takes part."""
