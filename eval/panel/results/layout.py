"""Rows and cells of a panel, and what was declared about them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ...verdict import Comparison
from ..specification import Cell, PanelSpec
from .matrix import Matrix, Row


@dataclass(frozen=True)
class PanelLayout:
    """Rows and cells of a panel, and what was declared about them.

    Attributes:
        rows: all rows.
        cells: all cells by name.
        cells_of: names of the cells that a row was evaluated in.
        reference: name of the reference cell; None where the plant has no reference.
        family: declared comparisons (row, cell).
        compare: declared pairs of rows.
    """

    rows: tuple[Row, ...]
    cells: Mapping[str, Cell]
    cells_of: Mapping[str, tuple[str, ...]]
    reference: str | None
    family: Sequence[tuple[str, str]] = ()
    compare: Sequence[tuple[str, str]] = ()

    @classmethod
    def of(cls, spec: PanelSpec, rows: tuple[Row, ...]) -> PanelLayout:
        """Rows of a panel with the cells that each is evaluated in."""
        own = {row.name: spec.cells_of(row.trained_on) for row in rows}
        every = [*spec.columns(), *(cell for cells in own.values() for cell in cells)]
        return cls(
            rows=rows,
            cells={cell.name: cell for cell in every},
            cells_of={row: tuple(cell.name for cell in cells) for row, cells in own.items()},
            reference=next((c.name for c in every if c.kind == "reference"), None),
            family=spec.family,
            compare=spec.compare,
        )

    def native(self, cell: str) -> str | None:
        """The row that was trained in a cell alone, if there is one."""
        if self.cells[cell].perturbation is not None:
            return None
        wanted = self.cells[cell].discretization
        return next((row.name for row in self.rows if row.trained_on == wanted), None)

    def reference_of(self, cell: str) -> str | None:
        """The reference cell, where it has the same plant and control period."""
        return self.reference if self.cells[cell].kind in ("grid", "reference") else None

    def columns(self) -> tuple[str, ...]:
        """Names of the cells that every row is evaluated in."""
        return tuple(n for n, c in self.cells.items() if c.kind in ("grid", "reference"))

    def comparison(self, matrix: Matrix, row: str, cell: str) -> Comparison:
        """The transfer of a row with a home to a cell, as it is judged."""
        native, home = self.native(cell), matrix.home_rates(row)
        assert home is not None
        return Comparison(
            name=f"{row} → {cell}",
            home=home,
            native=None if native in (None, row) else matrix.rates(str(native), cell),
            transferred=matrix.rates(row, cell),
        )
