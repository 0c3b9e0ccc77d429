"""Rows and cells of a panel, and what was declared about them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from ...power import Comparison
from ...verdict import FIRST_SHARE, UNSOLVABLE, Achieved, Attempt, Looks, Loss, Rates, split
from ..model.matrix import AppliedDiscretization
from ..model.panel import Look
from ..running.evaluation.achievability import Tried
from ..running.run_directory import Seen, looks_before, spent_by
from ..specification.cells.cell import Cell
from ..specification.panel_spec import PanelSpec
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
        looks: every look at the verdicts so far, this one included.
        looks_before: those before this one, and those that were planned.
        tried: what a hand-made controller and a search reach, by cell.
        applied: what the cells' environments really did, by cell.
    """

    rows: tuple[Row, ...]
    cells: Mapping[str, Cell]
    cells_of: Mapping[str, tuple[str, ...]]
    reference: str | None
    family: Sequence[tuple[str, str]] = ()
    compare: Sequence[tuple[str, str]] = ()
    looks: tuple[Look, ...] = ()
    looks_before: Looks = field(default_factory=Looks)
    tried: Mapping[str, Tried] = field(default_factory=dict)
    applied: Mapping[str, AppliedDiscretization] = field(default_factory=dict)

    @classmethod
    def of(
        cls,
        spec: PanelSpec,
        rows: tuple[Row, ...],
        tried: Mapping[str, Tried],
        applied: Mapping[str, AppliedDiscretization],
        looks: Sequence[Seen] = (),
    ) -> PanelLayout:
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
            looks=_looks(looks, spec.looks),
            looks_before=looks_before(looks[:-1], spec.looks)[-1],
            tried=tried,
            applied=applied,
        )

    @property
    def looked(self) -> Looks:
        """All looks so far, this one included."""
        return self.looks_before.then(self.looks[-1].seeds) if self.looks else self.looks_before

    @property
    def share(self) -> float:
        """Of the level, what this look has for comparisons of two rows."""
        if not self.looks:
            return FIRST_SHARE
        return self.looks_before.shares(self.looks[-1].seeds).exceeds

    def native(self, cell: str) -> str | None:
        """The row that was trained in a cell alone, if there is one."""
        if self.cells[cell].perturbation is not None:
            return None
        wanted = self.cells[cell].discretization
        return next((row.name for row in self.rows if row.trained_on == wanted), None)

    def reference_of(self, matrix: Matrix, cell: str) -> str | None:
        """The reference cell, where it has the same plant and control period.

        None where the cell cannot be solved in time, so that failing there says nothing.
        """
        same = self.cells[cell].kind in ("grid", "reference")
        unsolvable = same and self.achieved(matrix, cell).status in UNSOLVABLE
        return self.reference if same and not unsolvable else None

    def columns(self) -> tuple[str, ...]:
        """Names of the cells that every row is evaluated in."""
        return tuple(n for n, c in self.cells.items() if c.kind in ("grid", "reference"))

    def rates(self, matrix: Matrix, row: str, cell: str) -> Rates | None:
        """What the loss of a row in a cell is made of; None without a home."""
        native, home = self.native(cell), matrix.home_rates(row)
        if home is None:
            return None
        return Rates(
            home,
            matrix.rates(row, cell),
            matrix.recovered_rates(row, cell),
            None if native in (None, row) else matrix.recovered_rates(str(native), cell),
            self._tried(cell).recovered or None,
        )

    def loss(self, matrix: Matrix, row: str, cell: str) -> Loss | None:
        """The loss of a row in a cell; None at home and without one."""
        rates = self.rates(matrix, row, cell)
        return None if rates is None or cell == matrix.rows[row].home else split(rates)

    def losses(self, matrix: Matrix) -> dict[tuple[str, str], Loss]:
        """Every loss that there is, by row and cell."""
        places = [(row.name, cell) for row in self.rows for cell in self.cells_of[row.name]]
        found = {place: self.loss(matrix, *place) for place in places}
        return {place: loss for place, loss in found.items() if loss is not None}

    def achieved(self, matrix: Matrix, cell: str) -> Achieved:
        """Whether a cell can be solved: by any policy, or by what was tried before."""
        native = self.native(cell)
        attempts = []
        for row in self.rows:
            if row.kind != "baseline" and matrix.has(row.name, cell):
                name = "there" if row.name == native else f"on {row.name}"
                who = f"Policies trained {name}" if row.kind == "trained" else row.name
                rates = matrix.rates(row.name, cell), matrix.recovered_rates(row.name, cell)
                attempts.append(Attempt(who, *(float(rate.mean()) for rate in rates)))
        return self._tried(cell).achieved(*attempts)

    def comparison(self, matrix: Matrix, row: str, cell: str) -> Comparison:
        """The transfer of a row with a home to a cell, as it is judged."""
        rates = self.rates(matrix, row, cell)
        assert rates is not None
        return Comparison(f"{row} → {cell}", rates, self.achieved(matrix, cell))

    def _tried(self, cell: str) -> Tried:
        return self.tried.get(cell, Tried())


def _looks(seen: Sequence[Seen], planned: Sequence[int]) -> tuple[Look, ...]:
    """Looks with the levels that they spend, from what there was at each."""
    return tuple(
        Look(
            seeds=look.seeds,
            episodes=look.episodes,
            natives=look.natives,
            level_exceeds=own.levels[0],
            level_equivalent=own.levels[1],
            adopted=look.spent is not None,
        )
        for look, own in zip(seen, spent_by(seen, planned), strict=True)
    )
