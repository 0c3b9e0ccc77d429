"""One record as text to read."""

from __future__ import annotations

import json
from collections.abc import Iterator
from datetime import datetime
from typing import Any

import numpy as np
import numpy.typing as npt

from integ_gym.evidence.fields import SUMMARY_FIELDS
from integ_gym.evidence.record import EvidenceRecord

BARS = "▁▂▃▄▅▆▇█"
ASCII_BARS = "_.-=+*#@"

_WIDTH = 40
_NOTHING = "-"


def show(record: EvidenceRecord, bars: str = BARS) -> str:
    """The record by groups, each value with its unit, and its trace column by column.

    Args:
        record: the record.
        bars: characters for low to high values.
    """
    fields = record.fields
    title = f"{fields['env_id']}, episode {fields['episode_index']}: {fields['failure_label']}"
    return "\n".join([title, *_groups(record), *_arguments(record), *_trace(record, bars)])


def _groups(record: EvidenceRecord) -> Iterator[str]:
    group = ""
    for field in SUMMARY_FIELDS:
        if field.name == "arguments":
            continue
        if field.group != group:
            group = field.group
            yield from ("", group)
        unit = record.units.get(field.name, "")
        yield _line(field.name, number(record.fields.get(field.name)), unit)


def _arguments(record: EvidenceRecord) -> Iterator[str]:
    yield from ("", "constructor arguments")
    for name, argument in json.loads(record.fields["arguments"]).items():
        yield _line(name, number(argument["value"]), argument["unit"])


def _trace(record: EvidenceRecord, bars: str) -> Iterator[str]:
    if not record.trace:
        yield from ("", f"no trace: trace_every is {record.fields['trace_every']}")
        return
    yield from ("", "trace")
    heads = (f"{'':26}", f"{'first':>11}", f"{'least':>11}", f"{'most':>11}", f"{'last':>11}")
    yield "".join(heads)
    for name, values in record.trace.items():
        if not len(values):
            continue
        numbers = (values[0], values.min(), values.max(), values[-1])
        columns = "".join(f"{x:>11.4g}" for x in numbers)
        line = f"{name:<24}{columns}  {sparkline(values, bars)} {_unit(record.units[name])}"
        yield f"  {line}".rstrip()


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
        return _NOTHING
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.9g}"
    if isinstance(value, datetime):
        return value.isoformat()
    if isinstance(value, list):
        return ", ".join(number(x) for x in value)
    return str(value)


def _line(name: str, value: str, unit: str) -> str:
    shown = "" if value == _NOTHING else _unit(unit)
    return f"  {name:<26}{value} {shown}".rstrip()


def _unit(unit: str) -> str:
    return "" if unit == "1" else unit
