"""The result of a query, printed as a table, CSV or JSON."""

from __future__ import annotations

import csv
import json
from collections.abc import Sequence
from typing import Any, Final, TextIO

from integ_gym.support.terminal import (
    beside,
    print_aligned,
    say,
    stands_in_columns,
    visible,
    width_of,
)

from ..episodes.record import plain
from ..schema.arrow import arrow_type
from ..schema.fields import SUMMARY_FIELDS
from .showing import NOTHING, number

TABLE_FORMATS = ("table", "csv", "json")

_UNREAD: Final = 120  # characters in a line where no terminal says how many
_FEW: Final = 10  # rows that are printed one column a line even there
_VAGUE: Final = ("", "1", "SI", "m, rad")  # none, or another for each plant
_LINES: Final = 5  # of a cell that has its name beside it


def print_table(table: Any, file: TextIO, form: str = "table") -> None:
    """Print an Arrow table.

    Args:
        table: the table.
        file: where to.
        form: ``table`` (numbers shortened, a long list as the number of its values, texts whole; of
            more columns than there is room for, one in a line, with units and long texts cut),
            ``csv`` or ``json`` (an array of objects); the latter two give every value in full.

    Raises:
        ValueError: for another format.
    """
    printers = {"table": _readable, "csv": _csv, "json": _json}
    if form not in printers:
        raise ValueError(f"the format must be one of {', '.join(TABLE_FORMATS)}, got {form!r}")
    columns = [column.to_pylist() for column in table.columns]
    printers[form](table.schema, [list(row) for row in zip(*columns, strict=True)], file)


def _readable(schema: Any, rows: list[list[Any]], file: TextIO) -> None:
    numeric = [all(isinstance(row[i], (int, float)) for row in rows) for i in range(len(schema))]
    names = [visible(name) for name in schema.names]
    cells = [[_short(value) for value in row] for row in rows]
    width = width_of(file)
    listed = width is not None or len(rows) <= _FEW
    if listed and not stands_in_columns(names, cells, width or _UNREAD):
        _print_lists(names, _with_units(schema, cells), file, width or _UNREAD)
    else:
        print_aligned(names, cells, file, numeric)
    print(f"({len(rows)} row{'' if len(rows) == 1 else 's'})", file=file)


def _print_lists(
    names: Sequence[str], rows: Sequence[Sequence[str]], file: TextIO, width: int
) -> None:
    """Each row as lines of a name and a cell, and how to see what had to be cut."""
    before, cut = max(map(len, names)) + 2, False
    for row in rows:
        for name, cell in zip(names, row, strict=True):
            whole = beside(f"{name:<{before}}", cell, width)
            shown = beside(f"{name:<{before}}", cell, width, _LINES)
            cut = cut or shown != whole
            print(shown, file=file)
        print(file=file)
    if cut:
        say("Cells that end with ... are cut; --format json gives every value in full.", file)


def _with_units(schema: Any, rows: list[list[str]]) -> list[list[str]]:
    """Cells with the units of the fields whose names and types their columns have."""
    fields = {(field.name, arrow_type(field.kind)): field.unit for field in SUMMARY_FIELDS}
    units = [fields.get((column.name, column.type), "") for column in schema]
    return [[_with_unit(*told) for told in zip(row, units, strict=True)] for row in rows]


def _with_unit(cell: str, unit: str) -> str:
    return cell if cell == NOTHING or unit in _VAGUE else f"{cell} {unit}"


def _csv(schema: Any, rows: list[list[Any]], file: TextIO) -> None:
    writer = csv.writer(file, lineterminator="\n")
    seen = visible if file.isatty() else str
    writer.writerow(map(seen, schema.names))
    for row in rows:
        cells = [json.dumps(plain(x)) if isinstance(x, list) else plain(x) for x in row]
        writer.writerow([seen(x) if isinstance(x, str) else x for x in cells])


def _json(schema: Any, rows: list[list[Any]], file: TextIO) -> None:
    records = [dict(zip(schema.names, map(plain, row), strict=True)) for row in rows]
    print(json.dumps(records, indent=2, allow_nan=False, default=str), file=file)


def _short(value: Any) -> str:
    if isinstance(value, list) and len(value) > 4:
        return f"[{len(value)} values]"
    return number(value)
