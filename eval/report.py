"""The report of a panel: one HTML file that opens offline and needs nothing beside it.

The page is written from ``panel.json`` alone. It loads nothing, and its content security policy
forbids that it ever does; the only script is named there by its hash, so that no text of a panel
can become one.
"""

import json
import math
import shlex
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import resources
from os import PathLike
from pathlib import Path
from typing import Any, Final
from urllib.parse import quote

from integ_gym.eval import verdict as rules
from integ_gym.eval.page import page_environment, page_parts
from integ_gym.eval.report_data import (
    CLASS_WORDS,
    NONE,
    PASS,
    VERDICT_ORDER,
    Cell,
    Check,
    Entry,
    Estimate,
    Gap,
    Group,
    Json,
    Ladder,
    Panel,
    Row,
    Rung,
    compact,
    estimate,
    finite,
    fixed,
    plural,
    seconds,
    step,
)
from integ_gym.eval.report_engines import engine_lines
from integ_gym.eval.report_remedy import costs_of, line_words, remedies_of, success_of
from integ_gym.evidence.atomic import replace_file

FILE_NAME: Final = "report.html"
"""Name of the report in a panel's directory."""

SHOWN_GAPS: Final = 30
"""Exploratory gaps that are drawn; all of them are among the records."""

SHOWN_FINDINGS: Final = 7
"""Conclusions that are shown at once; the others are one click away."""

VIRIDIS: Final = [
    "440154",
    "48186a",
    "472d7b",
    "424086",
    "3b528b",
    "33638d",
    "2c728e",
    "26828e",
    "21918c",
    "1fa088",
    "28ae80",
    "3fbc73",
    "5ec962",
    "84d44b",
    "addc30",
    "d8e219",
    "fde725",
]
"""Stops of the map for success, from 0 to 1: perceptually uniform, safe for the colour-blind."""

MARKERS: Final = ("circle", "square", "triangle", "diamond", "down", "plus", "cross")
"""Shapes that tell series apart where colour cannot."""

LABEL_WORDS: Final = {
    "evaluation_error": "simulator or metric broke",
    "discretization_error": "succeeds from the same start at home",
    "perception_error": "succeeds without sensor noise",
    "state_error": "succeeds without delay or staleness",
    "control_error": "saturated, or left the goal after reaching it",
    "planning_error": "never reached the goal, unsaturated",
    "unattributed": "a needed replay was not run",
}
"""Failure labels in words, in the order in which their rules are tried."""

KIND_WORDS: Final = {
    "trained": "trained on",
    "given": "given policies",
    "baseline": "baselines",
}
"""Headings of the matrix's blocks of rows."""

_PLOT: Final = (36.0, 12.0, 286.0, 176.0)  # left, top, right, bottom of a ladder's axes
_ENERGY_FLOOR: Final = 1e-4  # share of the largest residual below which colour is linear


def write_report(panel: Json, directory: str | PathLike[str]) -> Path:
    """Write ``report.html`` into a panel's directory.

    Parameters
    ----------
    panel
        Content of ``panel.json``, schema version 1.
    directory
        The panel's directory; made if it does not exist.

    Returns
    -------
    Path of the file, which is complete as soon as it is there.

    Raises
    ------
    ModuleNotFoundError
        If jinja2 is not installed, with the command that installs it.
    ValueError
        If ``panel`` is of another schema version or contradicts itself.
    """
    return replace_file(Path(directory) / FILE_NAME, render(panel).encode())


def render(panel: Json) -> str:
    """The report's HTML.

    Raises
    ------
    ModuleNotFoundError, ValueError
        As `write_report`.
    """
    text: str = _template().render(_context(Panel(panel)))
    return text


@cache
def _template() -> Any:
    environment = page_environment()
    environment.filters.update(href=_href, success_of=success_of, line_words=line_words)
    source = resources.files("integ_gym.eval").joinpath("report.html.j2").read_text("utf-8")
    return environment.from_string(source)


def _context(panel: Panel) -> dict[str, Any]:
    return {
        **page_parts(),
        "panel": panel,
        "tiles": _tiles(panel),
        "cards": [_card(panel, gap, raw, _gap_axis(panel)) for gap, raw in panel.verdicts],
        "success": _matrix(panel, _success_cells),
        "returns": _returns(panel),
        "energy": _energy(panel),
        "gaps": _gaps(panel),
        "remedies": remedies_of(panel),
        "engine_lines": engine_lines(panel),
        "costs": costs_of(panel),
        "rate_axis": RATE_AXIS,
        "ladders": _ladders(panel),
        "checks": _checks(panel),
        "trust": panel.trust,
        "failure_table": _failure_table(panel),
        "failures": _failures(panel),
        "comparisons": [_comparison(raw) for raw in panel.items("policy_comparisons")],
        "records": _records(panel),
        "limits": _limits(panel),
        "settings": _settings(panel),
        "spec_json": json.dumps(panel.mapping("spec"), indent=2, ensure_ascii=False, default=str),
        "rules": rules,
        "pass_line": PASS,
        "class_words": CLASS_WORDS,
        "label_words": LABEL_WORDS,
        "shown_findings": SHOWN_FINDINGS,
        "ramp": ", ".join(f"#{stop}" for stop in VIRIDIS),
        "plural": plural,
    }


def _href(path: str) -> str:
    """A link to a file of the panel, always relative to the report."""
    return "./" + quote(path.replace("\\", "/").lstrip("/"), safe="/=")


def _folder(panel: Panel) -> str:
    """The panel's directory as its command names it, else the one that holds the report."""
    try:
        words = shlex.split(panel.text("command"))
    except ValueError:
        return "."
    for place, word in enumerate(words):
        if word == "--out" and place + 1 < len(words):
            return words[place + 1]
        if word.startswith("--out="):
            return word.removeprefix("--out=")
    return "."


# Tiles and verdicts -----------------------------------------------------------------------------


def _tiles(panel: Panel) -> list[tuple[str, str]]:
    """Headline counts: (number, what it counts)."""
    trained = [row for row in panel.rows if row.kind == "trained"]
    policies = sum(row.seeds for row in panel.rows if row.kind != "baseline")
    wrong = [e for t in panel.trust for e in t.judged if str(e.reference_class)[:5] == "false"]
    tiles = []
    if trained:
        mixtures = sum(row.mixed for row in trained)
        more = f" and {plural(mixtures, 'mixture')}" if mixtures else ""
        tiles.append((f"{len(trained) - mixtures}", f"training discretizations{more}"))
    tiles += [
        (f"{policies}", "policies" if policies != 1 else "policy"),
        (f"{len(panel.cells)}", "evaluation cells"),
        (f"{panel.episodes:,}", "episodes, each on record"),
    ]
    if panel.trust:
        tiles.append((f"{len(wrong)}", "answers the reference contradicts"))
    if finite(panel.mapping("cost").get("wall_seconds")) is not None:
        tiles.append((seconds(panel.mapping("cost")["wall_seconds"]), "to train and evaluate"))
    return tiles


def _card(panel: Panel, gap: Gap, raw: Json, axis: "Axis") -> dict[str, Any]:
    """One verdict of the declared family."""
    p_values = [
        (words, finite(raw.get(name)))
        for words, name in (
            (f"gap > {rules.FAIL_MARGIN}", "p_exceeds_adjusted"),
            (f"gap within ±{rules.EQUIVALENCE_MARGIN}", "p_equivalent_adjusted"),
        )
    ]
    verdict = gap.verdict if gap.verdict in VERDICT_ORDER else "inconclusive"
    return {
        "gap": gap,
        "verdict": verdict,
        "mark": {"fails": "✕", "transfers": "✓", "inconclusive": "?", "not_learned": "○"}[verdict],
        "word": {"not_learned": "not learned"}.get(verdict, verdict),
        "quantity": gap.quantity.replace("_", " "),
        "bar": axis.bar(gap.value) if gap in panel.declared_gaps else None,
        "axis": axis,
        "reason": str(raw.get("reason") or "").replace(" -0.", " −0."),
        "p_values": [
            (words, rules.p_text(value)) for words, value in p_values if value is not None
        ],
    }


# Axes of percentages ----------------------------------------------------------------------------


@dataclass(frozen=True)
class Axis:
    """A horizontal axis whose positions are percentages of the drawing's width."""

    low: float
    high: float
    ticks: tuple[float, ...]

    def at(self, value: float) -> float:
        """Position of a value, cut to the axis, in percent with room for markers."""
        share = (min(max(value, self.low), self.high) - self.low) / (self.high - self.low)
        return round(2.0 + 96.0 * share, 2)

    def bar(self, value: Estimate) -> dict[str, float]:
        """Positions of an estimate and the ends of its interval."""
        low, high = value.ends
        return {"at": self.at(value.estimate), "low": self.at(low), "high": self.at(high)}


RATE_AXIS: Final = Axis(0.0, 1.0, (0.0, 0.25, 0.5, 0.75, 1.0))
"""Axis of success rates."""


def _gap_axis(panel: Panel) -> Axis:
    """One axis for all gaps, with the lines at 0, ±0.1 and 0.2 always inside."""
    gaps = [*panel.declared_gaps, *panel.exploratory_gaps[:SHOWN_GAPS]]
    return difference_axis([gap.value for gap in gaps])


def difference_axis(values: Iterable[Estimate], size: float = 0.2) -> Axis:
    """An axis for differences of rates that holds all of them and the margins of the verdicts."""
    ends = [end for value in values for end in (value.estimate, *value.ends)]
    low = math.floor(min([-0.2, *ends]) * 5.0 - 1e-9) / 5.0
    high = math.ceil(max([0.4, *ends]) * 5.0 + 1e-9) / 5.0
    low, high = max(low, -1.0), min(high, 1.0)
    size = size if high - low <= 1.6 else 0.5
    first, last = math.ceil(low / size - 1e-9), math.floor(high / size + 1e-9)
    return Axis(low, high, tuple(round(size * k, 2) for k in range(first, last + 1)))


def _gaps(panel: Panel) -> dict[str, Any]:
    axis = _gap_axis(panel)
    shown = panel.exploratory_gaps[:SHOWN_GAPS]

    def lines(gaps: Sequence[Gap]) -> list[dict[str, Any]]:
        return [{"gap": gap, "bar": axis.bar(gap.value)} for gap in gaps]

    return {
        "axis": axis,
        "declared": lines(panel.declared_gaps),
        "exploratory": lines(shown),
        "total": len(panel.exploratory_gaps),
        "levels": _level([gap.value for gap in (*panel.declared_gaps, *shown)]),
        "drops": any(g.quantity == "home_drop" for g in (*panel.declared_gaps, *shown)),
    }


def _level(values: Iterable[Estimate]) -> str:
    """The level that the intervals share, as text; empty where they have none or several."""
    levels = {value.level for value in values if value.level is not None}
    return f"{levels.pop():.0%}".replace("%", " %") if len(levels) == 1 else ""


# Matrices ---------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Shade:
    """What one cell of a matrix shows.

    Attributes
    ----------
    text, style, tone
        The number, its inline style and its class.
    marks
        Short signs under the number.
    title
        The cell in words.
    """

    text: str
    style: str
    tone: str
    marks: tuple[str, ...]
    title: str
    entry: Entry
    home: bool


@dataclass(frozen=True)
class Line:
    """One row of a matrix."""

    row: Row
    shades: tuple[tuple[Group, tuple[tuple[Cell, Shade | None], ...]], ...]


@dataclass(frozen=True)
class Block:
    """Rows of one kind under a heading."""

    title: str
    lines: tuple[Line, ...]


def _matrix(panel: Panel, shade: Any) -> tuple[Block, ...]:
    """Rows of a matrix by kind; ``shade`` turns an entry into what its cell shows."""
    blocks = []
    for kind, title in KIND_WORDS.items():
        rows = [row for row in panel.ordered_rows if _block_kind(row) == kind]
        if rows:
            blocks.append(Block(title, tuple(_line(panel, row, shade) for row in rows)))
    return tuple(blocks)


def _block_kind(row: Row) -> str:
    return row.kind if row.kind in KIND_WORDS else "given"


def _line(panel: Panel, row: Row, shade: Any) -> Line:
    shades = []
    for group in panel.groups:
        cells = []
        for cell in group.cells:
            entry = panel.entry(row, cell)
            cells.append((cell, None if entry is None else shade(entry)))
        shades.append((group, tuple(cells)))
    return Line(row, tuple(shades))


def _success_cells(entry: Entry) -> Shade:
    rate = None if entry.success is None else entry.success.estimate
    style = ""
    if rate is not None:
        background = success_colour(rate)
        style = f"background:{background};color:{ink_on(background)}"
    marks = []
    if entry.reference_class == "false_pass":
        marks.append("▲")
    if entry.reference_class == "false_fail":
        marks.append("▽")
    if entry.diverged:
        marks.append(f"✕{entry.diverged}")
    return Shade(
        fixed(rate), style, "" if style else "empty", tuple(marks), _words(entry), entry, entry.home
    )


def _words(entry: Entry) -> str:
    """A cell of the success matrix in words, for tooltips and screen readers."""
    parts = [f"{entry.row.name}, evaluated on {entry.cell.name}: success {_interval(entry)}"]
    if entry.episodes is not None:
        parts.append(plural(entry.episodes, "episode"))
    if entry.home:
        parts.append("its training discretization")
    if entry.reference_class:
        parts.append(f"a {CLASS_WORDS.get(entry.reference_class, entry.reference_class)}")
    if entry.diverged:
        parts.append(f"{entry.diverged} diverged")
    return "; ".join(parts)


def _interval(entry: Entry) -> str:
    return "not known" if entry.success is None else str(entry.success)


def success_colour(rate: float) -> str:
    """Colour of a success rate, as ``#rrggbb``."""
    place = min(max(rate, 0.0), 1.0) * (len(VIRIDIS) - 1)
    below = min(int(place), len(VIRIDIS) - 2)
    pair = (_channels(VIRIDIS[below]), _channels(VIRIDIS[below + 1]))
    share = place - below
    mixed = (round(one + share * (other - one)) for one, other in zip(*pair, strict=True))
    return "#" + "".join(f"{channel:02x}" for channel in mixed)


def ink_on(background: str) -> str:
    """Black or white, whichever reads better on a ``#rrggbb`` background (WCAG contrast)."""
    linear = [
        channel / 12.92 if channel <= 0.04045 else ((channel + 0.055) / 1.055) ** 2.4
        for channel in (value / 255.0 for value in _channels(background.lstrip("#")))
    ]
    luminance = 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]
    return "#000000" if (luminance + 0.05) / 0.05 > 1.05 / (luminance + 0.05) else "#ffffff"


def _channels(colour: str) -> tuple[int, int, int]:
    return int(colour[:2], 16), int(colour[2:4], 16), int(colour[4:6], 16)


def _returns(panel: Panel) -> dict[str, Any] | None:
    """Matrix of returns, where no truth judges success; None if the panel has none."""
    shown = [e.returns.estimate for e in panel.entries.values() if e.returns is not None]
    if panel.truth is not None or not shown:
        return None
    low, high = min(shown), max(shown)

    def shade(entry: Entry) -> Shade:
        return _return_cell(entry, low, high)

    return {"blocks": _matrix(panel, shade), "low": low, "high": high}


def _return_cell(entry: Entry, low: float, high: float) -> Shade:
    value = None if entry.returns is None else entry.returns.estimate
    title = f"{entry.row.name}, evaluated on {entry.cell.name}: return {compact(value, 4)}"
    if value is None:
        return Shade(NONE, "", "empty", (), title, entry, entry.home)
    background = success_colour((value - low) / (high - low) if high > low else 1.0)
    style = f"background:{background};color:{ink_on(background)}"
    return Shade(compact(value, 3), style, "", (), title, entry, entry.home)


def _energy(panel: Panel) -> dict[str, Any] | None:
    """Matrix of energy residuals, None if the panel has none."""
    shown = [e for e in panel.entries.values() if e.cell in panel.columns and e.energy_residual]
    sizes = [abs(e.energy_residual.estimate) for e in shown if e.energy_residual]
    largest = max(sizes, default=0.0)
    if not shown:
        return None
    floor = largest * _ENERGY_FLOOR

    def shade(entry: Entry) -> Shade:
        return _energy_cell(entry, floor, largest)

    return {"blocks": _matrix(panel, shade), "largest": largest, "floor": floor}


def _energy_cell(entry: Entry, floor: float, largest: float) -> Shade:
    residual = entry.energy_residual
    value = None if residual is None else residual.estimate
    alpha = 0.0 if value is None else symlog(abs(value), floor, largest)
    tone = "empty" if value is None else "warm" if value > 0.0 else "cool"
    spread = "" if residual is None or not residual.bounded else _ends(residual)
    title = f"{entry.row.name}, evaluated on {entry.cell.name}: "
    title += "energy residual not known" if value is None else f"{compact(value, 3, True)} J"
    text = compact(value, 2, True)
    return Shade(text, f"--a:{alpha:.3f}", tone, (), title + spread, entry, entry.home)


def _ends(value: Estimate) -> str:
    low, high = (compact(end, 3, True) for end in value.ends)
    return f" ({low} to {high} J)"


def symlog(value: float, floor: float, largest: float) -> float:
    """Share in [0, 1] of a size on a logarithmic scale that is linear below ``floor``."""
    if largest <= 0.0 or floor <= 0.0:
        return 0.0
    return math.asinh(value / floor) / math.asinh(largest / floor)


# Ladders ----------------------------------------------------------------------------------------


def _ladders(panel: Panel) -> dict[str, Any] | None:
    if not panel.ladders:
        return None
    found = dict.fromkeys(
        scheme for ladder in panel.ladders for scheme in (*ladder.fixed, *ladder.following)
    )
    schemes = {scheme: place for place, scheme in enumerate(found)}
    return {
        "schemes": [
            {"name": name, "place": place % len(MARKERS), "shape": MARKERS[place % len(MARKERS)]}
            for name, place in schemes.items()
        ],
        "rows": [_ladder(ladder, schemes) for ladder in panel.ladders],
        "follows": any(ladder.following for ladder in panel.ladders),
        "plot": dict(zip(("left", "top", "right", "bottom"), _PLOT, strict=True)),
    }


def _ladder(ladder: Ladder, schemes: Mapping[str, int]) -> dict[str, Any]:
    truth = ladder.truth.success if ladder.truth is not None else None
    return {
        "row": ladder.row,
        "period": ladder.control_period,
        "truth": truth,
        "fixed": _ladder_plot(ladder.fixed, schemes, truth),
        "following": _ladder_plot(ladder.following, schemes, None),
    }


def _ladder_plot(
    rungs: Mapping[str, tuple[Rung, ...]], schemes: Mapping[str, int], truth: Estimate | None
) -> dict[str, Any] | None:
    """Geometry of one small plot in a frame of 300 by 210."""
    steps = sorted({rung.dt for line in rungs.values() for rung in line}, reverse=True)
    if not steps:
        return None
    ticks = steps if len(steps) < 6 else steps[:: math.ceil(len(steps) / 5)]
    return {
        "lines": [
            _ladder_line(scheme, line, schemes[scheme], len(schemes), steps)
            for scheme, line in rungs.items()
        ],
        "ticks": [(_ladder_x(dt, steps), step(dt)) for dt in ticks],
        "truth": None if truth is None else _ladder_y(truth.estimate),
        "values": [(rate, _ladder_y(rate)) for rate in (0.0, 0.25, 0.5, 0.75, 1.0)],
    }


def _ladder_line(
    scheme: str, line: Sequence[Rung], place: int, count: int, steps: Sequence[float]
) -> dict[str, Any]:
    """Points of one scheme, moved aside a little so that equal rates stay visible."""
    aside = (place - (count - 1) / 2.0) * 2.6
    points = []
    for rung in line:
        rate = rung.entry.success
        if rate is not None:
            low, high = rate.ends
            points.append(
                {
                    "x": round(_ladder_x(rung.dt, steps) + aside, 1),
                    "y": _ladder_y(rate.estimate),
                    "low": _ladder_y(low),
                    "high": _ladder_y(high),
                    "title": f"{scheme}, step {step(rung.dt)} s: success {rate}",
                }
            )
    return {
        "name": scheme,
        "place": place % len(MARKERS),
        "shape": MARKERS[place % len(MARKERS)],
        "points": points,
        "path": " ".join(f"{point['x']},{point['y']}" for point in points),
    }


def _ladder_x(dt: float, steps: Sequence[float]) -> float:
    """Coarse steps on the left, equal factors equally far apart."""
    left, _, right, _ = _PLOT
    span = math.log(steps[0] / steps[-1])
    share = math.log(steps[0] / dt) / span if span > 0.0 else 0.5
    return round(left + 22.0 + share * (right - left - 40.0), 1)


def _ladder_y(rate: float) -> float:
    _, top, _, bottom = _PLOT
    return round(bottom - min(max(rate, 0.0), 1.0) * (bottom - top), 1)


# Perturbations, failures, comparisons -----------------------------------------------------------


def _checks(panel: Panel) -> list[dict[str, Any]]:
    return [
        {"label": label, "lines": [_check(check) for check in checks]}
        for label, checks in panel.checks.items()
    ]


def _check(check: Check) -> dict[str, Any]:
    before = None if check.before is None else check.before.success
    after = check.after.success
    change = None
    if before is not None and after is not None:
        change = after.estimate - before.estimate
    base = check.before.cell.name if check.before is not None else check.after.cell.name
    return {
        "row": check.after.row.name,
        "cell": base,
        "anchor": check.after.anchor,
        "before": before,
        "after": after,
        "before_bar": None if before is None else RATE_AXIS.bar(before),
        "after_bar": None if after is None else RATE_AXIS.bar(after),
        "change": fixed(change, sign=True),
    }


def _failure_table(panel: Panel) -> dict[str, Any] | None:
    """Failures by row and label, with the share of each label in its row."""
    if not panel.labels:
        return None
    names = [name for name in LABEL_WORDS if any(name in c for c in panel.labels.values())]
    others = {name for counts in panel.labels.values() for name in counts} - set(names)
    names += sorted(others)
    lines = []
    for row, counts in panel.labels.items():
        total = sum(counts.values())
        shares = [(counts.get(name, 0), counts.get(name, 0) / total) for name in names]
        lines.append({"row": row, "total": total, "shares": shares})
    return {"labels": names, "lines": lines}


def _failures(panel: Panel) -> list[dict[str, Any]]:
    """The sample of failing episodes, by label, each with the command that shows its record."""
    by_label: dict[str, list[dict[str, Any]]] = {}
    for raw in panel.items("failures"):
        label = str(raw.get("label") or "unattributed")
        by_label.setdefault(label, []).append(_failure(panel, raw))
    labels = sorted(by_label, key=lambda name: -len(by_label[name]))
    return [{"label": label, "records": by_label[label]} for label in labels]


def _failure(panel: Panel, raw: Json) -> dict[str, Any]:
    row, cell = str(raw.get("row")), str(raw.get("cell"))
    entry = panel.entries.get((row, cell))
    words = ("integ-gym", "evidence", "show", _folder(panel), str(raw.get("record_id")))
    return {
        "row": row,
        "cell": cell,
        "anchor": None if entry is None else entry.anchor,
        "policy": raw.get("policy"),
        "episode": raw.get("episode_index"),
        "reason": str(raw.get("reason") or "no reason recorded"),
        "command": " ".join(shlex.quote(word) for word in words),
    }


def _comparison(raw: Json) -> dict[str, Any]:
    """One comparison of two policies."""
    cells = []
    differences = [estimate(cell.get("difference")) for cell in raw.get("cells") or []]
    axis = difference_axis([value for value in differences if value is not None], 0.5)
    for cell, value in zip(raw.get("cells") or [], differences, strict=True):
        cells.append(
            {
                "name": str(cell.get("name")),
                "role": {"quarter_step": "dt/4", "reference": "truth"}.get(str(cell.get("role"))),
                "status": str(cell.get("status") or "undecided").replace("_", " "),
                "value": value,
                "bar": None if value is None else axis.bar(value),
            }
        )
    outcome = str(raw.get("outcome") or "uninformative")
    tones = {"accepted": "transfers", "rejected": "fails"}
    return {
        "a": str(raw.get("a")),
        "b": str(raw.get("b")),
        "outcome": outcome,
        "tone": tones.get(outcome, "inconclusive"),
        "mark": {"accepted": "✓", "rejected": "✕"}.get(outcome, "?"),
        "reason": str(raw.get("reason") or "").replace(" -0.", " −0."),
        "cells": cells,
        "axis": axis,
    }


# Records, method, reproduction ------------------------------------------------------------------


def _records(panel: Panel) -> list[dict[str, Any]]:
    """Every entry of the matrix, row by row, in the order of the columns."""
    order = {cell.name: place for place, cell in enumerate(panel.columns)}
    blocks = []
    for row in panel.ordered_rows:
        entries = [entry for entry in panel.entries.values() if entry.row == row]
        entries.sort(key=lambda entry: order.get(entry.cell.name, len(order)))
        if entries:
            blocks.append({"row": row, "entries": [_record(entry) for entry in entries]})
    return blocks


def _record(entry: Entry) -> dict[str, Any]:
    """The numbers of one entry as (name, text) pairs."""
    facts = [
        ("success", _long(entry.success, fixed)),
        ("return", _long(entry.returns, _three)),
        ("time to success", _time_to_success(entry)),
        ("energy residual", _long(entry.energy_residual, _signed, " J")),
        ("energy residual, size", _long(entry.energy_residual_abs, _three, " J")),
        ("home drop", _long(entry.home_drop, fixed)),
        ("transfer gap", _long(entry.transfer_gap, fixed)),
        ("against the reference", CLASS_WORDS.get(entry.reference_class or "")),
        ("diverged", str(entry.diverged) if entry.diverged else None),
        ("solver not converged", str(entry.not_converged) if entry.not_converged else None),
    ]
    return {
        "entry": entry,
        "facts": [(name, text) for name, text in facts if text],
        "seeds": [RATE_AXIS.at(rate) for rate in entry.success_by_seed],
        "labels": sorted(entry.labels.items(), key=lambda item: -item[1]),
    }


def _time_to_success(entry: Entry) -> str | None:
    """The mean over successful episodes, and how many they are."""
    text = _long(entry.time_to_success, _three, " s")
    if text is None or entry.time_to_success_episodes is None:
        return text
    return f"{text}, {entry.time_to_success_episodes} of {entry.episodes} episodes"


def _three(value: float | None) -> str:
    return compact(value, 3)


def _signed(value: float | None) -> str:
    return compact(value, 3, True)


def _long(value: Estimate | None, show: Any, unit: str = "") -> str | None:
    if value is None:
        return None
    if not value.bounded:
        return f"{show(value.estimate)}{unit}"
    return f"{show(value.estimate)} ({show(value.low)} to {show(value.high)}){unit}"


def _limits(panel: Panel) -> list[str]:
    """What this panel cannot say, from its own numbers."""
    rows = [row for row in panel.rows if not row.baseline]
    fewest = min((row.seeds for row in rows), default=0)
    limits = []
    if rows and fewest < rules.MIN_SEEDS:
        limits.append(
            f"Some rows have {plural(fewest, 'seed')}; below {rules.MIN_SEEDS} seeds nothing is "
            "concluded, whatever the numbers look like."
        )
    if rows and fewest < 15:
        limits.append(
            "Showing that a policy transfers takes many seeds: with every rate at 1.0, a transfer "
            "gap needs 15 seeds a side in a family of one and 32 in a family of eight. "
            f"Here the rows have {fewest} or more, so inconclusive is not the same as fails."
        )
    if panel.truth is None:
        limits.append("There is no reference column, so no class against the truth.")
    unlearned = [row.name for row in rows if row.learned is False]
    if unlearned:
        limits.append(
            f"Not learned, hence without a verdict: {', '.join(unlearned)} (home success below "
            f"{rules.LEARNED})."
        )
    limits += [str(gap) for gap in panel.raw.get("protocol_gaps") or []]
    limits.append(
        "Everything outside the declared family is exploratory: its intervals are not adjusted "
        "for how many there are."
    )
    return limits


def _settings(panel: Panel) -> list[tuple[str, str]]:
    """Entries of the spec that are plain values, and the environment's own arguments."""
    spec = panel.mapping("spec")
    flat = [(str(name), _plain(value)) for name, value in spec.items() if _is_plain(value)]
    for group in ("environment", "training"):
        inner = spec.get(group)
        if isinstance(inner, Mapping):
            flat += [(str(name), _plain(value)) for name, value in inner.items()]
    return flat


def _is_plain(value: Any) -> bool:
    if isinstance(value, list):
        return all(not isinstance(item, list | Mapping) for item in value)
    return not isinstance(value, Mapping)


def _plain(value: Any) -> str:
    if isinstance(value, bool) or value is None:
        return {True: "true", False: "false", None: "none"}[value]
    if isinstance(value, list):
        return ", ".join(_plain(item) for item in value)
    return json.dumps(value) if isinstance(value, Mapping) else str(value)
