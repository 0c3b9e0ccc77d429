"""A panel, parsed: ``panel.json`` of schema version 1, its matrix grouped as a reader meets it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import cached_property
from typing import Any, Final

from integ_gym.eval.formatting import finite
from integ_gym.eval.report_data.parts import (
    KIND_WORDS,
    Cell,
    Entry,
    Group,
    Json,
    Row,
    objects,
    read_cell,
    read_entry,
    read_row,
)

SCHEMA_VERSION: Final = 1
"""Version of ``panel.json`` that is understood here."""


@dataclass
class Panel:
    """A panel, parsed.

    Raises
    ------
    ValueError
        If the schema version is another one, a name occurs twice, or the matrix names a row or
        cell that the panel does not declare.
    """

    raw: Json
    rows: tuple[Row, ...] = field(init=False)
    cells: tuple[Cell, ...] = field(init=False)

    def __post_init__(self) -> None:
        version = self.raw.get("schema_version")
        if version != SCHEMA_VERSION:
            raise ValueError(
                f"expected panel schema_version {SCHEMA_VERSION}, got {version!r}; "
                "use the integ-gym version that wrote the panel"
            )
        self.rows = tuple(read_row(i, raw) for i, raw in enumerate(objects(self.raw, "rows")))
        self.cells = tuple(read_cell(i, raw) for i, raw in enumerate(objects(self.raw, "cells")))
        self.entries = self._matrix()

    def _matrix(self) -> dict[tuple[str, str], Entry]:
        rows, cells = _by_name(self.rows, "row"), _by_name(self.cells, "cell")
        entries: dict[tuple[str, str], Entry] = {}
        for raw in objects(self.raw, "matrix"):
            key = (str(raw.get("row")), str(raw.get("cell")))
            if key[0] not in rows or key[1] not in cells:
                raise ValueError(f"the matrix has {key}, but rows and cells do not declare both")
            if key in entries:
                raise ValueError(f"the matrix has {key} more than once")
            entries[key] = read_entry(rows[key[0]], cells[key[1]], raw)
        return entries

    def text(self, name: str, default: str = "") -> str:
        """A top-level text, or the default where it is missing or null."""
        value = self.raw.get(name)
        return default if value is None else str(value)

    def mapping(self, name: str) -> Json:
        """A top-level object, empty where it is missing or null."""
        value = self.raw.get(name)
        return value if isinstance(value, Mapping) else {}

    def items(self, name: str) -> list[Json]:
        """A top-level list of objects, empty where it is missing or null."""
        return objects(self.raw, name)

    def entry(self, row: Row | None, cell: Cell | None) -> Entry | None:
        """What a row did in a cell, or None where it was not evaluated."""
        if row is None or cell is None:
            return None
        return self.entries.get((row.name, cell.name))

    @cached_property
    def groups(self) -> tuple[Group, ...]:
        """Columns of the success matrix, the reference last."""
        by_scheme: dict[str, list[Cell]] = {}
        truth = [cell for cell in self.cells if cell.reference]
        for cell in self.cells:
            if cell.kind == "grid" and cell.plain and not cell.reference:
                by_scheme.setdefault(cell.scheme, []).append(cell)
        groups = [Group(name, _coarse_first(cells)) for name, cells in by_scheme.items()]
        if truth:
            groups.append(Group("reference", tuple(truth), reference=True))
        return tuple(groups)

    @cached_property
    def columns(self) -> tuple[Cell, ...]:
        """Cells of the success matrix, in column order."""
        return tuple(cell for group in self.groups for cell in group.cells)

    @cached_property
    def ordered_rows(self) -> tuple[Row, ...]:
        """Trained rows, then given policies, then baselines."""
        order = list(KIND_WORDS)
        return tuple(sorted(self.rows, key=lambda row: order.index(row.block)))

    @cached_property
    def truth(self) -> Cell | None:
        """The reference cell, or None."""
        return next((cell for cell in self.cells if cell.reference), None)

    @cached_property
    def mixed_periods(self) -> bool:
        """Whether the matrix mixes control periods, so that columns must name theirs."""
        return len({cell.control_period for cell in self.columns}) > 1

    @cached_property
    def largest_residual(self) -> float | None:
        """Largest size of an energy residual in the matrix, J; None if it has none."""
        found = (e.energy_residual for e in self.entries.values() if e.cell in self.columns)
        return max((abs(value.estimate) for value in found if value is not None), default=None)

    @cached_property
    def episodes(self) -> int:
        """Number of evaluation episodes in the panel."""
        return sum(entry.episodes or 0 for entry in self.entries.values())

    @cached_property
    def labels(self) -> Mapping[str, Mapping[str, int]]:
        """For every row with failures, how often each failure label was given."""
        counts: dict[str, Counter[str]] = {}
        for row in self.ordered_rows:
            total: Counter[str] = Counter()
            for cell in self.cells:
                entry = self.entry(row, cell)
                total.update({} if entry is None else entry.labels)
            total.pop("none", None)
            if sum(total.values()):
                counts[row.name] = total
        return counts

    @cached_property
    def failures_total(self) -> int:
        """Number of failed episodes: those with a label, or what the panel says of them."""
        counted = sum(sum(counts.values()) for counts in self.labels.values())
        return counted or int(finite(self.raw.get("failures_total")) or 0)

    @cached_property
    def created(self) -> str:
        """When the panel was made, to the minute."""
        text = self.text("created")
        try:
            moment = datetime.fromisoformat(text)
        except ValueError:
            return text
        zone = "" if moment.tzinfo is None else " UTC"
        return f"{moment.astimezone(UTC) if zone else moment:%Y-%m-%d %H:%M}{zone}"

    @cached_property
    def warnings(self) -> tuple[str, ...]:
        """What the reader must know before trusting anything here."""
        return tuple(str(text) for text in self.raw.get("warnings") or [])


def _by_name(items: Iterable[Any], kind: str) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for item in items:
        if item.name in found:
            raise ValueError(f"expected {kind} names that differ, got {item.name!r} twice")
        found[item.name] = item
    return found


def _coarse_first(cells: Iterable[Cell]) -> tuple[Cell, ...]:
    return tuple(sorted(cells, key=lambda cell: (-(cell.control_period or 0.0), -(cell.dt or 0.0))))
