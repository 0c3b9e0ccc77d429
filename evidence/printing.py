"""One record as text to read."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterator, Sequence
from datetime import datetime
from typing import Any, Final, TextIO

import numpy as np
import numpy.typing as npt

from integ_gym.support.errors import InputError
from integ_gym.support.terminal import (
    beside,
    print_aligned,
    say,
    stands_in_columns,
    visible,
    width_of,
)

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
    parts = (_groups(record, width), _arguments(record, width), _trace(record, bars, width))
    head = [beside("", title, width), beside("", record.reason, width)]
    return "\n".join([*head, *(line for part in parts for line in part)])


def _groups(record: EvidenceRecord, width: int | None) -> Iterator[str]:
    group = ""
    for field in sorted(SUMMARY_FIELDS, key=lambda field: field.group not in _LEADING):
        if field.name == "arguments":
            continue
        if field.group != group:
            group = field.group
            yield from ("", group)
        unit = record.units.get(field.name, "")
        yield _line(field.name, number(record.fields.get(field.name)), unit, width)


def _arguments(record: EvidenceRecord, width: int | None) -> Iterator[str]:
    yield from ("", "constructor arguments")
    for name, argument in parse_arguments(record.fields["arguments"]).items():
        yield _line(name, number(argument["value"]), argument["unit"], width)


def _trace(record: EvidenceRecord, bars: str, width: int | None) -> Iterator[str]:
    if not record.trace:
        yield from ("", f"no trace: trace_every is {record.fields['trace_every']}")
        return
    yield from ("", "trace")
    yield f"{'':{_NAME}}" + "".join(f"{head:>11}" for head in ("first", "least", "most", "last"))
    for name, values in record.trace.items():
        if len(values):
            yield from _column(name, values, _unit(record.units[name]), bars, width)


def _column(
    name: str, values: npt.NDArray[Any], unit: str, bars: str, width: int | None
) -> Iterator[str]:
    """A column of the trace; its sketch in a line of its own where there is no room beside."""
    told = (values[0], values.min(), values.max(), values[-1])
    numbers = f"  {name:<{_NAME - 2}}" + "".join(f"{x:>11.4g}" for x in told)
    sketch = sparkline(values, bars)
    if width is None or len(numbers) + len(unit) + _WIDTH + 3 <= width:
        yield f"{numbers}  {sketch} {unit}".rstrip()
    else:
        yield f"{numbers}  {unit}".rstrip()
        yield f"{'':{_NAME}}{sketch}"


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
    return visible(str(value))


def _line(name: str, value: str, unit: str, width: int | None) -> str:
    shown = "" if value == NOTHING else _unit(unit)
    return beside(f"  {name:<{_NAME - 2}}", f"{value} {shown}".rstrip(), width)


def _unit(unit: str) -> str:
    return "" if unit == "1" else unit


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
        raise InputError(f"the format must be one of {', '.join(TABLE_FORMATS)}, got {form!r}")
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
