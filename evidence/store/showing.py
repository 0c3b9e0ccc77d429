"""One record as text to read."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import datetime
from typing import Any

import numpy as np
import numpy.typing as npt

from integ_gym.support.terminal import beside, visible

from ..episodes.record import EvidenceRecord, told_arguments
from ..schema.fields import SUMMARY_FIELDS

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
    return "\n".join([beside("", title, width), *(line for part in parts for line in part)])


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
    for name, argument in told_arguments(record.fields["arguments"]).items():
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
