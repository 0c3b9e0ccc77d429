"""The result of a query, printed as a table, CSV or JSON."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Sequence
from datetime import datetime
from typing import Any, TextIO

from integ_gym.evidence.show import number

FORMATS = ("table", "csv", "json")

_LONGEST = 60


def print_table(table: Any, file: TextIO, form: str = "table") -> None:
    """Print an Arrow table.

    Args:
        table: the table.
        file: where to.
        form: ``table`` (numbers shortened, a list as the number of its values), ``csv`` or
            ``json`` (an array of objects); the latter two give every value in full.

    Raises:
        ValueError: for another format.
    """
    printers = {"table": _aligned, "csv": _csv, "json": _json}
    if form not in printers:
        raise ValueError(f"the format must be one of {', '.join(FORMATS)}, got {form!r}")
    columns = [column.to_pylist() for column in table.columns]
    printers[form](table.column_names, [list(row) for row in zip(*columns, strict=True)], file)


def _aligned(names: list[str], rows: list[list[Any]], file: TextIO) -> None:
    numeric = [all(isinstance(row[i], (int, float)) for row in rows) for i in range(len(names))]
    print_aligned(names, [[_short(value) for value in row] for row in rows], file, numeric)
    print(f"({len(rows)} row{'' if len(rows) == 1 else 's'})", file=file)


def print_aligned(
    names: Sequence[str],
    rows: Sequence[Sequence[str]],
    file: TextIO,
    right: Sequence[bool] | None = None,
) -> None:
    """Print cells in columns under their names.

    Args:
        names: of the columns.
        rows: the cells.
        file: where to.
        right: which columns are flush right; None: none.
    """
    cells = [names, *rows]
    widths = [max(len(row[i]) for row in cells) for i in range(len(names))]
    cells.insert(1, ["-" * width for width in widths])
    for row in cells:
        padded = (
            cell.rjust(width) if flush else cell.ljust(width)
            for cell, width, flush in zip(row, widths, right or [False] * len(names), strict=True)
        )
        print("  ".join(padded).rstrip(), file=file)


def _csv(names: list[str], rows: list[list[Any]], file: TextIO) -> None:
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow(names)
    for row in rows:
        writer.writerow([json.dumps(_plain(x)) if isinstance(x, list) else _plain(x) for x in row])


def _json(names: list[str], rows: list[list[Any]], file: TextIO) -> None:
    records = [dict(zip(names, map(_plain, row), strict=True)) for row in rows]
    print(json.dumps(records, indent=2, allow_nan=False, default=str), file=file)


def _short(value: Any) -> str:
    if isinstance(value, list) and len(value) > 4:
        return f"[{len(value)} values]"
    text = number(value)
    return text if len(text) <= _LONGEST else text[: _LONGEST - 3] + "..."


def _plain(value: Any) -> Any:
    """A value fit for JSON: times as ISO 8601, what is not finite as null."""
    if isinstance(value, datetime):
        return value.isoformat()
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, list):
        return [_plain(x) for x in value]
    if isinstance(value, dict):
        return {key: _plain(x) for key, x in value.items()}
    return value
