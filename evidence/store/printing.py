"""The result of a query, printed as a table, CSV or JSON."""

from __future__ import annotations

import csv
import json
from typing import Any, TextIO

from integ_gym.support import print_aligned, visible

from ..episodes import plain
from .showing import number

TABLE_FORMATS = ("table", "csv", "json")


def print_table(table: Any, file: TextIO, form: str = "table") -> None:
    """Print an Arrow table.

    Args:
        table: the table.
        file: where to.
        form: ``table`` (numbers shortened, a long list as the number of its values, texts whole),
            ``csv`` or ``json`` (an array of objects); the latter two give every value in full.

    Raises:
        ValueError: for another format.
    """
    printers = {"table": _aligned, "csv": _csv, "json": _json}
    if form not in printers:
        raise ValueError(f"the format must be one of {', '.join(TABLE_FORMATS)}, got {form!r}")
    columns = [column.to_pylist() for column in table.columns]
    printers[form](table.column_names, [list(row) for row in zip(*columns, strict=True)], file)


def _aligned(names: list[str], rows: list[list[Any]], file: TextIO) -> None:
    numeric = [all(isinstance(row[i], (int, float)) for row in rows) for i in range(len(names))]
    names = [visible(name) for name in names]
    print_aligned(names, [[_short(value) for value in row] for row in rows], file, numeric)
    print(f"({len(rows)} row{'' if len(rows) == 1 else 's'})", file=file)


def _csv(names: list[str], rows: list[list[Any]], file: TextIO) -> None:
    writer = csv.writer(file, lineterminator="\n")
    seen = visible if file.isatty() else str
    writer.writerow(map(seen, names))
    for row in rows:
        cells = [json.dumps(plain(x)) if isinstance(x, list) else plain(x) for x in row]
        writer.writerow([seen(x) if isinstance(x, str) else x for x in cells])


def _json(names: list[str], rows: list[list[Any]], file: TextIO) -> None:
    records = [dict(zip(names, map(plain, row), strict=True)) for row in rows]
    print(json.dumps(records, indent=2, allow_nan=False, default=str), file=file)


def _short(value: Any) -> str:
    if isinstance(value, list) and len(value) > 4:
        return f"[{len(value)} values]"
    return number(value)
