"""How far each discretization agrees with the reference."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from ...panel.model.matrix import Cell, Entry
from ...panel.model.panel import Panel

CLASS_WORDS: Final = {
    "true_pass": "true pass",
    "false_pass": "false pass",
    "false_fail": "false fail",
    "true_fail": "true fail",
}
"""The classes against the reference in words."""


@dataclass(frozen=True)
class Trust:
    """How far one discretization agrees with the reference."""

    cell: Cell
    judged: tuple[Entry, ...]

    def of(self, kind: str) -> tuple[Entry, ...]:
        """Entries of one class against the reference."""
        return tuple(entry for entry in self.judged if entry.reference_class == kind)

    @property
    def agreeing(self) -> int:
        """Number of rows that the cell and the reference agree about."""
        return len(self.of("true_pass")) + len(self.of("true_fail"))


def trust_of(panel: Panel) -> tuple[Trust, ...]:
    """Every cell of the matrix that has a class against the reference, in column order."""
    found = []
    for cell in panel.columns:
        if cell.reference:
            continue
        entries = (panel.entry(row.name, cell.name) for row in panel.ordered_rows)
        judged = tuple(e for e in entries if e is not None and e.reference_class)
        if judged:
            found.append(Trust(cell, judged))
    return tuple(found)
