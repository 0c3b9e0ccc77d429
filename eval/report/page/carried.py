"""What the page's script is told: rows, cells, every entry's numbers, other measures, episodes."""

from __future__ import annotations

import shlex
from collections.abc import Callable
from typing import Any

from integ_gym.support.terminal import (
    compact,
    fixed,
    percent,
    step,
    together,
)

from ...film.film import LEAST_START
from ...panel.model.matrix import Entry
from ...panel.model.panel import Panel
from ...panel.model.part import Estimate
from ..data.matrices import (
    Matrix,
    energy_matrix,
    loss_matrix,
    mean_words,
    return_matrix,
    solved_words,
    success_matrix,
    time_matrix,
)
from ..data.trust import CLASS_WORDS
from ..episodes.choice import chosen_words
from ..episodes.packing import packed
from ..episodes.task import TaskWords
from ..episodes.told import Told
from .commands import readable
from .drawing import shading
from .failures import LABEL_WORDS

_MEASURES = (
    ("success", success_matrix),
    ("loss", loss_matrix),
    ("return", return_matrix),
    ("energy", energy_matrix),
    ("time to success", time_matrix),
)


def carried_by(
    panel: Panel, told: Told | None, task: TaskWords | None, href: Callable[[str], str]
) -> str:
    """Everything, packed.

    Args:
        panel: what the page is about.
        told: of single episodes; None where no evidence is beside the panel.
        task: what is asked; None where that is not known.
        href: from a file of the panel to a link.
    """
    cells = {cell.name: place for place, cell in enumerate(panel.cells)}
    files = {name for entry in panel.matrix for name in entry.file}
    head = {
        "directory": panel.directory,
        "scene": task.scene if task else None,
        "choice": chosen_words(panel),
        "leastStart": LEAST_START,
        "labelWords": LABEL_WORDS,
        "files": {name: href(name) for name in sorted(files)},
        "cells": [{"name": c.name, "shown": panel.called(c.name)} for c in panel.cells],
        "rows": [
            {
                "shown": panel.called(row.name),
                "homes": [cells[name] for name in row.shares if name in cells],
                "policies": [
                    {
                        "id": policy.id,
                        "seed": policy.seed,
                        "hash": policy.hash and policy.hash[:16],
                        "file": policy.file and href(policy.file),
                    }
                    for policy in row.policies
                ],
            }
            for row in panel.rows
        ],
        "groups": [
            {
                "name": group.label,
                "truth": group.reference,
                "steps": [step(cell.dt) for cell in group.cells],
            }
            for group in panel.groups
        ],
        "entries": {_place(panel, entry): _entry(panel, entry) for entry in panel.matrix},
        "measures": [
            _measure(panel, name, found)
            for name, matrix in _MEASURES
            if (found := matrix(panel)) is not None
        ],
    }
    return packed(panel, told, head, lambda text: together(panel.said(text)))


def _place(panel: Panel, entry: Entry) -> str:
    anchor = panel.anchor(entry.row, entry.cell) or ""
    return anchor.removeprefix("r").replace("c", "/")


def _measure(panel: Panel, name: str, matrix: Matrix) -> dict[str, Any]:
    cells = {
        panel.anchor(line.row.name, cell.name): [
            shade.text,
            shading(shade),
            " ".join(shade.marks),
            panel.said(shade.words),
            shade.tone,
        ]
        for block in matrix.blocks
        for line in block.lines
        for _, shades in line.shades
        for cell, shade in shades
        if shade is not None
    }
    return {
        "name": name,
        "about": matrix.about,
        "ends": matrix.ends,
        "notes": [panel.said(note) for note in matrix.notes],
        "signed": matrix.signed,
        "cells": cells,
    }


def _entry(panel: Panel, entry: Entry) -> dict[str, Any]:
    try:
        query = readable(shlex.split(entry.query))
    except ValueError:
        query = entry.query
    facts = [[name, together(panel.said(text))] for name, text in _facts(panel, entry) if text]
    return {"facts": facts, "file": entry.file, "query": query}


def _facts(panel: Panel, entry: Entry) -> list[tuple[str, str | None]]:
    """The numbers of one entry as (name, text) pairs."""
    return [
        ("success", _long(entry.success, fixed)),
        (f"return, {mean_words(panel)}", _long(entry.returns, _three)),
        ("time to success", _time_to_success(entry)),
        ("energy residual", _long(entry.energy_residual, _signed, " J")),
        ("energy residual, size", _long(entry.energy_residual_abs, _three, " J")),
        ("within two horizons", _long(entry.recovered, fixed)),
        ("loss against home", _long(entry.home_drop, fixed)),
        ("of it difficulty", _long(entry.difficulty, fixed)),
        ("of it deadline", _long(entry.deadline, fixed)),
        ("of it overfitting", _long(entry.overfitting, fixed)),
        ("seeds that lose more than half", _long(entry.tail, fixed)),
        ("worst seed", entry.worst_policy and f"{entry.worst_policy}, {fixed(entry.worst_loss)}"),
        ("energy from the numerics", _long(entry.numerics_share, _share)),
        ("transfer gap", _long(entry.transfer_gap, fixed)),
        ("against the truth", CLASS_WORDS.get(entry.reference_class or "")),
        ("the cell", solved_words(panel.cell(entry.cell))),
        ("episodes", f"{entry.episodes:,}"),
        ("diverged", str(entry.diverged) if entry.diverged else None),
        ("solver not converged", str(entry.not_converged) if entry.not_converged else None),
    ]


def _time_to_success(entry: Entry) -> str | None:
    """The mean over successful episodes, and how many they are."""
    text = _long(entry.time_to_success, _three, " s")
    if text is None:
        return None
    return f"{text}, {entry.time_to_success_episodes} of {entry.episodes} episodes"


def _three(value: float | None) -> str:
    return compact(value, 3)


def _share(value: float | None) -> str:
    """Of the energy gained until the goal is first reached."""
    return percent(value)


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
