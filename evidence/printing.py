"""One record as text to read."""

from __future__ import annotations

import csv
import json
from datetime import datetime
from typing import Any, Final, TextIO

import numpy as np
import numpy.typing as npt

from integ_gym.support import terminal

from .fields import SUMMARY_FIELDS
from .record import EvidenceRecord, plain
from .schema import arrow_type, parse_arguments

BARS = "▁▂▃▄▅▆▇█"
ASCII_BARS = "_.-=+*#@"
NOTHING = "-"

_WIDTH = 40
_NAME = 28

_LEADING = ("outcome", "ledger")
"""Groups that are shown before the others."""


def show(record: EvidenceRecord, bars: str = BARS, width: int | None = None) -> str:
    """What came of the episode, then the record by groups, and its trace column by column.

    Args:
        record: the record.
        bars: characters for low to high values.
        width: characters in a line; None: as many as it takes.
    """
    fields = record.fields
    outcome = "succeeds" if fields["success"] else f"fails, {fields['failure_label']}"
    title = f"{fields['env_id']}, {fields['cell']}, episode {fields['episode_index']}: {outcome}"
    lines = [
        terminal.hanging_indent("", title, width),
        terminal.hanging_indent("", record.reason, width),
    ]

    def add(name: str, value: Any, unit: str) -> None:
        shown = "" if value is None or unit == "1" else unit
        lines.append(
            terminal.hanging_indent(
                f"  {name:<{_NAME - 2}}", f"{number(value)} {shown}".rstrip(), width
            )
        )

    group = ""
    for field in sorted(SUMMARY_FIELDS, key=lambda field: field.group not in _LEADING):
        if field.name == "arguments":
            continue
        if field.group != group:
            group = field.group
            lines += ["", group]
        add(field.name, fields.get(field.name), record.units.get(field.name, ""))
    lines += ["", "constructor arguments"]
    for name, argument in parse_arguments(fields["arguments"]).items():
        add(name, argument["value"], argument["unit"])
    if not record.trace:
        return "\n".join([*lines, "", f"no trace: trace_every is {fields['trace_every']}"])
    heads = "".join(f"{head:>11}" for head in ("first", "least", "most", "last"))
    lines += ["", "trace", f"{'':{_NAME}}{heads}"]
    for name, values in record.trace.items():
        if len(values):
            unit = "" if record.units[name] == "1" else record.units[name]
            shown = (values[0], values.min(), values.max(), values[-1])
            numbers = f"  {name:<{_NAME - 2}}" + "".join(f"{x:>11.4g}" for x in shown)
            sketch = sparkline(values, bars)
            if width is None or len(numbers) + len(unit) + _WIDTH + 3 <= width:
                lines.append(f"{numbers}  {sketch} {unit}".rstrip())
            else:
                lines += [f"{numbers}  {unit}".rstrip(), f"{'':{_NAME}}{sketch}"]
    return "\n".join(lines)


def sparkline(values: npt.NDArray[Any], bars: str = BARS) -> str:
    """Means over equal stretches of ``values``, lowest to highest, as one line of characters."""
    parts = np.array_split(values.astype(np.float64), min(_WIDTH, len(values)))
    means = np.array([part.mean() for part in parts])
    span = means.max() - means.min()
    levels = (means - means.min()) / span if span > 0.0 else np.zeros(len(means))
    return "".join(bars[round(level * (len(bars) - 1))] for level in levels.tolist())


def number(value: Any) -> str:
    """A value in a few characters."""
    if value is None:
        return NOTHING
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.9g}"
    if isinstance(value, datetime):
        return value.isoformat()
    if isinstance(value, list):
        return ", ".join(number(x) for x in value)
    return terminal.visible(str(value))


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
    if form not in TABLE_FORMATS:
        raise ValueError(f"the format must be one of {', '.join(TABLE_FORMATS)}, got {form!r}")
    names = table.schema.names
    columns = [column.to_pylist() for column in table.columns]
    rows = [list(row) for row in zip(*columns, strict=True)]
    if form == "json":
        records = [dict(zip(names, map(plain, row), strict=True)) for row in rows]
        print(json.dumps(records, indent=2, allow_nan=False, default=str), file=file)
    elif form == "csv":
        writer = csv.writer(file, lineterminator="\n")
        seen = terminal.visible if file.isatty() else str
        writer.writerow(map(seen, names))
        for row in rows:
            cells = [json.dumps(plain(x)) if isinstance(x, list) else plain(x) for x in row]
            writer.writerow([seen(x) if isinstance(x, str) else x for x in cells])
    else:
        _print_readable(table.schema, rows, file)


def _print_readable(schema: Any, rows: list[list[Any]], file: TextIO) -> None:
    numeric = [all(isinstance(row[i], (int, float)) for row in rows) for i in range(len(schema))]
    names = [terminal.visible(name) for name in schema.names]
    cells = [
        [f"[{len(x)} values]" if isinstance(x, list) and len(x) > 4 else number(x) for x in row]
        for row in rows
    ]
    width = terminal.width_of(file)
    listed = width is not None or len(rows) <= _FEW
    if listed and terminal.column_widths(names, cells, width or _UNREAD) is None:
        fields = {(field.name, arrow_type(field.kind)): field.unit for field in SUMMARY_FIELDS}
        units = [fields.get((column.name, column.type), "") for column in schema]
        cells = [
            [
                x if x == NOTHING or u in _VAGUE else f"{x} {u}"
                for u, x in zip(units, row, strict=True)
            ]
            for row in cells
        ]
        cut = terminal.print_lists(names, cells, file, width or _UNREAD, _LINES)
        print(end="\n" if cells else "", file=file)
        if cut:
            terminal.print_wrapped(
                "Cells that end with ... are cut; --format json gives every value in full.", file
            )
    else:
        terminal.print_columns(names, cells, file, numeric)
    print(f"({len(rows)} row{'' if len(rows) == 1 else 's'})", file=file)
