"""The tables of docs/explanation/quick_panel.md on the quick panel, from a finished run.

    python benchmarks/panel_tables.py RUN [--save docs/quick_panel.json]
    python benchmarks/panel_tables.py docs/quick_panel.json
    python benchmarks/panel_tables.py docs/quick_panel_run.json.gz --figure runs/heatmap

Prints them in Markdown, every number with its 95 % interval over seeds and starts and rounded to
what that carries. `--save` keeps what they are made of, with
versions, instruction sets and one hash of all weights. `docs/quick_panel_run.json.gz` is the
`panel.json` of the run, compressed.
"""

from __future__ import annotations

import gzip
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
from measuring import results
from measuring.results import format_interval, format_p_value

from integ_gym.eval.panel.result import FILE_NAME, Panel, read_panel
from integ_gym.eval.report.drawing import draw_matrix
from integ_gym.eval.report.matrices import success_matrix
from integ_gym.eval.statistics import Estimate
from integ_gym.support.figures import write_figure

CELLS = {
    "explicit_euler dt=0.05": "explicit Euler 0.05",
    "symplectic_euler dt=0.05": "symplectic Euler 0.05",
    "implicit_euler dt=0.0125": "implicit Euler 0.0125",
    "reference dt=0.05": "truth",
}
"""Columns of the table of success."""

_SHOWN_BY = {"fails": "p_exceeds_adjusted"}


def read_run(path: Path) -> Panel:
    """A finished run, by its folder or by its published result."""
    if path.is_dir():
        return read_panel(path / FILE_NAME)
    return msgspec.json.decode(gzip.decompress(path.read_bytes()), type=Panel)


def draw_success(panel: Panel, path: Path) -> None:
    """Write the matrix of success, as in the run's own figures, to a path without a suffix."""
    matrix = success_matrix(panel)
    assert matrix is not None
    write_figure(draw_matrix(matrix), path)


def summary_of(panel: Panel) -> dict[str, Any]:
    """What the tables are made of, as plain data."""
    return {
        "command": panel.command,
        "versions": panel.versions,
        "instruction_sets": list(panel.instruction_sets),
        "weights": panel.weights,
        "wall_seconds": panel.cost.wall_seconds,
        "workers": panel.cost.workers,
        "rows": [_row(panel, row.name) for row in panel.rows if not row.baseline],
        "verdicts": [
            {
                "row": one.row, "cell": one.cell, "verdict": one.verdict,
                "p": getattr(one, _SHOWN_BY.get(one.verdict, "p_equivalent_adjusted")),
                **{part: _numbers(getattr(one, part))
                   for part in ("total", "difficulty", "deadline", "overfitting")},
            }
            for one in panel.verdicts
        ],
    }  # fmt: skip


def _row(panel: Panel, name: str) -> dict[str, Any]:
    row, cells = panel.row(name), {}
    for cell in CELLS:
        entry = panel.entry(name, cell)
        assert entry is not None
        cells[cell] = {
            "success": _numbers(entry.success),
            "recovered": _numbers(entry.recovered),
            "numerics_share": _numbers(entry.numerics_share),
            "tail": _numbers(entry.tail),
        }
    return {"row": name, "seeds": row.seeds, "home": _numbers(row.home_success), "cells": cells}


def _numbers(estimate: Estimate | None) -> list[float | None] | None:
    """Estimate, low and high."""
    if estimate is None:
        return None
    return [estimate.estimate, estimate.low, estimate.high]


def tables(summary: dict[str, Any]) -> Iterator[str]:
    """The Markdown, line by line."""
    yield f"| trained on | seeds | {' | '.join(CELLS.values())} |"
    yield "|---|---|" + "---|" * len(CELLS)
    for row in summary["rows"]:
        cells = (_success(row["cells"][cell]) for cell in CELLS)
        yield f"| {_named(row['row'])} | {row['seeds']} | {' | '.join(cells)} |"
    yield ""
    yield "| trained on | judged on | overfitting | deadline | difficulty | verdict | adjusted p |"
    yield "|---|---|---|---|---|---|---|"
    for one in summary["verdicts"]:
        parts = (format_interval(one[part]) for part in ("overfitting", "deadline", "difficulty"))
        yield (
            f"| {_named(one['row'])} | {_named(one['cell'])} | {' | '.join(parts)} | "
            f"{one['verdict']} | {format_p_value(one['p'])} |"
        )
    known = [cell["numerics_share"] for row in summary["rows"] for cell in row["cells"].values()]
    if not any(known):
        return
    yield ""
    yield f"| energy that the numerics gave | {' | '.join(CELLS.values())} |"
    yield "|---|" + "---|" * len(CELLS)
    for row in summary["rows"]:
        cells = (format_interval(row["cells"][cell]["numerics_share"]) for cell in CELLS)
        yield f"| {_named(row['row'])} | {' | '.join(cells)} |"


def _success(cell: dict[str, Any]) -> str:
    """Success with its interval, and behind a stroke that within two horizons."""
    return f"{format_interval(cell['success'])} / {cell['recovered'][0]:.2f}"


def _named(name: str) -> str:
    """A row or cell in code, its step behind it."""
    integrator, _, step = name.partition(" dt=")
    return f"`{integrator}` {step}".rstrip()


def main() -> None:
    """Print the tables, or draw the figure."""
    parser = results.parser(__doc__)
    parser.add_argument("run", type=Path, help="finished quick panel: folder, result or summary")
    parser.add_argument("--save", type=Path, metavar="FILE")
    parser.add_argument("--figure", type=Path, metavar="PATH", help="draw PATH.png, .svg and .pdf")
    given = parser.parse_args()
    if given.run.suffix == ".json":
        if given.figure:
            parser.error("a summary has too little for the figure; give the run or its result")
        summary = json.loads(given.run.read_text(encoding="utf-8"))
    else:
        panel = read_run(given.run)
        if given.figure:
            draw_success(panel, given.figure)
            return
        summary = summary_of(panel)
    print("\n".join(tables(summary)))
    if given.save:
        given.save.write_text(json.dumps(summary, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
