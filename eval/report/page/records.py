"""The report's list of every entry, with all its numbers."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from integ_gym.support import compact, fixed

from ...panel.model import Entry, Estimate, Panel
from ..data import CLASS_WORDS, RATE_AXIS, solved_words
from .drawing import percent


def records_of(panel: Panel) -> list[dict[str, Any]]:
    """Every entry of the matrix, row by row, in the order of the columns."""
    order = {cell.name: place for place, cell in enumerate(panel.columns)}
    blocks = []
    for row in panel.ordered_rows:
        entries = [entry for entry in panel.matrix if entry.row == row.name]
        entries.sort(key=lambda entry: order.get(entry.cell, len(order)))
        if entries:
            blocks.append({"row": row, "entries": [_record(panel, e) for e in entries]})
    return blocks


def _record(panel: Panel, entry: Entry) -> dict[str, Any]:
    """The numbers of one entry as (name, text) pairs."""
    facts = [
        ("success", _long(entry.success, fixed)),
        ("return", _long(entry.returns, _three)),
        ("time to success", _time_to_success(entry)),
        ("energy residual", _long(entry.energy_residual, _signed, " J")),
        ("energy residual, size", _long(entry.energy_residual_abs, _three, " J")),
        ("within two horizons", _long(entry.recovered, fixed)),
        ("home drop", _long(entry.home_drop, fixed)),
        ("of it difficulty", _long(entry.difficulty, fixed)),
        ("of it deadline", _long(entry.deadline, fixed)),
        ("of it overfitting", _long(entry.overfitting, fixed)),
        ("transfer gap", _long(entry.transfer_gap, fixed)),
        ("against the reference", CLASS_WORDS.get(entry.reference_class or "")),
        ("the cell", solved_words(panel.cell(entry.cell))),
        ("diverged", str(entry.diverged) if entry.diverged else None),
        ("solver not converged", str(entry.not_converged) if entry.not_converged else None),
    ]
    return {
        "entry": entry,
        "facts": [(name, text) for name, text in facts if text],
        "seeds": [percent(RATE_AXIS, rate) for rate in entry.success_by_seed],
        "labels": sorted(entry.labels.items(), key=lambda item: -item[1]),
    }


def _time_to_success(entry: Entry) -> str | None:
    """The mean over successful episodes, and how many they are."""
    text = _long(entry.time_to_success, _three, " s")
    if text is None:
        return None
    return f"{text}, {entry.time_to_success_episodes} of {entry.episodes} episodes"


def _three(value: float | None) -> str:
    return compact(value, 3)


def _signed(value: float | None) -> str:
    return compact(value, 3, True)


def _long(
    value: Estimate | None, show: Callable[[float | None], str], unit: str = ""
) -> str | None:
    if value is None:
        return None
    if not value.bounded:
        return f"{show(value.estimate)}{unit}"
    return f"{show(value.estimate)} ({show(value.low)} to {show(value.high)}){unit}"
