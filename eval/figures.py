"""Figures of a panel as PNG files, drawn from ``panel.json`` alone."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from integ_gym.envs.extras import load
from integ_gym.eval.figure_style import (
    ACCENT,
    COOL,
    INK,
    LINE,
    PAPER,
    SCHEME_COLOURS,
    SCHEME_MARKERS,
    SOFT,
    SUNK,
    WARM,
    axes_at,
    bare,
    blank_figure,
    draw_heading,
    inch_canvas,
    plain,
    png,
    scheme_legend,
)
from integ_gym.eval.remedy_figure import draw_remedy
from integ_gym.eval.report import (
    KIND_WORDS,
    difference_axis,
    ink_on,
    success_colour,
    symlog,
)
from integ_gym.eval.report_data import (
    NONE,
    Cell,
    Check,
    Entry,
    Estimate,
    Gap,
    Json,
    Ladder,
    Panel,
    Row,
    Rung,
    compact,
    fixed,
    step,
)
from integ_gym.eval.verdict import EQUIVALENCE_MARGIN, FAIL_MARGIN
from integ_gym.evidence.atomic import replace_file

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MAX_GAPS: Final = 24
"""Exploratory gaps drawn; the report lists more."""

MAX_LADDERS: Final = 12
"""Rows whose refinement ladders are drawn."""

MAX_CHECKS: Final = 40
"""Rows drawn for each perturbation."""

VERDICT_COLOURS: Final = {
    "fails": "#b8400a",
    "transfers": "#00724f",
    "inconclusive": "#7a5a00",
}
"""Colours of verdicts, as in the report."""

_CELL: Final = (0.62, 0.46)  # width and height of a matrix cell, inches
_GROUP_GAP: Final = 0.14  # inches between groups of columns
_TRUTH_GAP: Final = 0.34
_BOLD: Final = 0.0098  # width of a bold letter, inches per point of its size
_BLOCK_GAP: Final = 0.42  # inches between blocks of rows, where their heading stands


def write_figures(panel: Json, directory: str | PathLike[str]) -> list[Path]:
    """Write a panel's figures as PNG files into a folder.

    A figure for which the panel has no numbers is not written, and one left there by an earlier
    run under the same name is removed.

    Parameters
    ----------
    panel
        Content of ``panel.json``, schema version 1.
    directory
        The folder the files go to; made if it does not exist.

    Returns
    -------
    The files written, each complete as soon as it is there.

    Raises
    ------
    ModuleNotFoundError
        If matplotlib is not installed, with the command that installs it.
    ValueError
        If ``panel`` is of another schema version or contradicts itself.
    """
    load("matplotlib", "report")
    parsed, folder = Panel(panel), Path(directory)
    written = []
    for name, draw in _FIGURES.items():
        figure = draw(parsed)
        path = folder / name
        if figure is None:
            path.unlink(missing_ok=True)
        else:
            written.append(replace_file(path, png(figure)))
    return written


# Matrices ---------------------------------------------------------------------------------------


def _success(panel: Panel) -> Figure | None:
    """Success rate of every row in every discretization."""
    known = [e for e in panel.entries.values() if e.cell in panel.columns and e.success]
    if not known:
        return None
    return _matrix(
        panel,
        "Success, trained on × evaluated on",
        "share of episodes that succeed, mean over training seeds; columns: step in seconds",
        _draw_success,
        _success_legend,
    )


def _energy(panel: Panel) -> Figure | None:
    """Energy residual of every row in every discretization."""
    shown = [e for e in panel.entries.values() if e.cell in panel.columns and e.energy_residual]
    largest = max((abs(e.energy_residual.estimate) for e in shown if e.energy_residual), default=0)
    if not shown:
        return None
    floor = largest * 1e-4

    def draw(axes: Axes, x: float, y: float, entry: Entry) -> None:
        _draw_energy(axes, x, y, entry, floor, largest)

    def legend(axes: Axes, x: float, y: float) -> None:
        _energy_legend(axes, x, y, floor, largest)

    return _matrix(
        panel,
        "Energy that the numerics put in or took out",
        "energy residual, J per episode, mean over seeds; columns: step in seconds",
        draw,
        legend,
    )


def _matrix(
    panel: Panel,
    title: str,
    about: str,
    draw: Callable[[Axes, float, float, Entry], None],
    legend: Callable[[Axes, float, float], None],
) -> Figure:
    """Rows by kind, columns by integrator, the reference set apart."""
    left, top = 2.75, 1.62
    columns, right = _column_places(panel, left)
    rows, bottom = _row_places(panel, top)
    figure = blank_figure(max(right + 0.35, 7.2), bottom + 0.85)
    axes = inch_canvas(figure)
    draw_heading(axes, 0.3, title, about)
    _column_heads(axes, panel, columns, top, bottom)
    for row, y, heading in rows:
        if heading:
            axes.text(0.3, y - 0.1, heading, size=8.5, color=SOFT, va="baseline")
        name = plain(row.name, 38)
        axes.text(
            left - 0.14, y + _CELL[1] / 2, name, size=_fitting([name], left - 0.44, 9.0),
            color=INK, ha="right", va="center", weight="bold",
        )  # fmt: skip
        for cell, x in columns:
            entry = panel.entry(row, cell)
            if entry is None:
                _box(axes, x, y, SUNK)
                _cell_text(axes, x, y, NONE, SOFT)
            else:
                draw(axes, x, y, entry)
    legend(axes, left, bottom + 0.3)
    return figure


def _column_places(panel: Panel, left: float) -> tuple[list[tuple[Cell, float]], float]:
    """Left edge of every column in inches, and the right edge of the last."""
    places: list[tuple[Cell, float]] = []
    x = left
    for number, group in enumerate(panel.groups):
        if number:
            x += _TRUTH_GAP if group.reference else _GROUP_GAP
        for cell in group.cells:
            places.append((cell, x))
            x += _CELL[0]
    return places, x


def _row_places(panel: Panel, top: float) -> tuple[list[tuple[Row, float, str]], float]:
    """Top edge and heading of every row, and the bottom edge of the last."""
    places: list[tuple[Row, float, str]] = []
    y, last = top, ""
    for row in panel.ordered_rows:
        kind = row.kind if row.kind in KIND_WORDS else "given"
        heading = "" if kind == last else KIND_WORDS[kind]
        if heading and last:
            y += _BLOCK_GAP - 0.06
        places.append((row, y, heading))
        y, last = y + _CELL[1], kind
    return places, y


def _column_heads(
    axes: Axes, panel: Panel, columns: list[tuple[Cell, float]], top: float, bottom: float
) -> None:
    """Names of integrators over their steps."""
    place = {cell.name: x for cell, x in columns}
    widths = [len(group.cells) * _CELL[0] + 0.1 for group in panel.groups]
    names = ["truth" if group.reference else group.label for group in panel.groups]
    heads = [_head(name, width) for name, width in zip(names, widths, strict=True)]
    size = min(_fitting(head, width, 9.5) for head, width in zip(heads, widths, strict=True))
    for group, lines in zip(panel.groups, heads, strict=True):
        first, last = place[group.cells[0].name], place[group.cells[-1].name] + _CELL[0]
        axes.text(
            (first + last) / 2, top - 0.62, "\n".join(lines), color=INK, ha="center",
            size=size, weight="bold", va="bottom", linespacing=1.0,
        )  # fmt: skip
        if group.reference:
            edge = first - _TRUTH_GAP / 2
            axes.plot([edge, edge], [top - 0.75, bottom], color=INK, linewidth=1.2)
        else:
            axes.plot([first + 0.05, last - 0.05], [top - 0.54] * 2, color=LINE, linewidth=1)
        for cell in group.cells:
            _column_head(axes, panel, cell, place[cell.name] + _CELL[0] / 2, top)


def _fitting(lines: Sequence[str], width: float, size: float) -> float:
    """Size of bold text in points, at most ``size``, at which lines fit a width in inches."""
    return max(5.0, min(size, width / (_BOLD * max(len(line) for line in lines))))


def _head(label: str, width: float) -> list[str]:
    """A group's name on one line, or cut after underscores and spaces into two where narrow."""
    most = int(width / (_BOLD * 6.5))
    text = plain(label, max(2 * most, 8))
    if len(text) * _BOLD * 9.5 <= width:
        return [text]
    cuts = [place + 1 for place, letter in enumerate(text[:-1]) if letter in "_ "]
    cut = min(cuts, key=lambda place: abs(place - len(text) / 2), default=len(text))
    return [line.strip() for line in (text[:cut], text[cut:]) if line.strip()]


def _column_head(axes: Axes, panel: Panel, cell: Cell, x: float, top: float) -> None:
    text = "reference" if cell.reference else step(cell.dt)
    axes.text(x, top - 0.36, text, size=7.5, color=SOFT, ha="center", va="baseline")
    if panel.mixed_periods:
        period = f"every {step(cell.control_period)}"
        axes.text(x, top - 0.22, period, size=6.5, color=SOFT, ha="center", va="baseline")


def _box(axes: Axes, x: float, y: float, colour: str) -> None:
    from matplotlib.patches import Rectangle

    gap = 0.02
    size = _CELL[0] - 2 * gap, _CELL[1] - 2 * gap
    axes.add_patch(Rectangle((x + gap, y + gap), *size, facecolor=colour, linewidth=0))


def _home_frame(axes: Axes, x: float, y: float) -> None:
    from matplotlib.patches import Rectangle

    for inset, colour, width in ((0.03, PAPER, 2.6), (0.008, INK, 1.9)):
        size = _CELL[0] - 2 * inset, _CELL[1] - 2 * inset
        axes.add_patch(
            Rectangle((x + inset, y + inset), *size, fill=False, edgecolor=colour, linewidth=width)
        )


def _cell_text(
    axes: Axes, x: float, y: float, text: str, colour: str, size: float = 9.5, up: float = 0.0
) -> None:
    axes.text(
        x + _CELL[0] / 2, y + _CELL[1] / 2 - up, text, size=size, color=colour, ha="center",
        va="center_baseline" if up else "center", weight="normal",
    )  # fmt: skip


def _draw_success(axes: Axes, x: float, y: float, entry: Entry) -> None:
    rate = None if entry.success is None else entry.success.estimate
    colour = SUNK if rate is None else success_colour(rate)
    ink = SOFT if rate is None else ink_on(colour)
    marks = {"false_pass": ["▲"], "false_fail": ["▽"]}.get(str(entry.reference_class), [])
    if entry.diverged:
        marks = [*marks, f"×{entry.diverged}"]
    _box(axes, x, y, colour)
    if entry.home:
        _home_frame(axes, x, y)
    _cell_text(axes, x, y, fixed(rate), ink, up=0.05 if marks else 0.0)
    if marks:
        _cell_text(axes, x, y, " ".join(marks), ink, size=6.5, up=-0.13)


def _draw_energy(
    axes: Axes, x: float, y: float, entry: Entry, floor: float, largest: float
) -> None:
    residual = entry.energy_residual
    value = None if residual is None else residual.estimate
    if value is None:
        _box(axes, x, y, SUNK)
    else:
        share = symlog(abs(value), floor, largest)
        _box(axes, x, y, _tint(WARM if value > 0.0 else COOL, share))
    if entry.home:
        _home_frame(axes, x, y)
    text = compact(value, 2, True)
    _cell_text(axes, x, y, text, SOFT if value is None else INK, size=6.8 if len(text) > 7 else 8)


def _tint(colour: str, share: float) -> str:
    """A colour thinned with the paper's."""
    channels = (int(colour[place : place + 2], 16) for place in (1, 3, 5))
    return "#" + "".join(f"{round(255 + share * (value - 255)):02x}" for value in channels)


def _ramp(axes: Axes, x: float, y: float, colour: Callable[[float], str]) -> None:
    """A colour scale one inch wide."""
    from matplotlib.patches import Rectangle

    parts = 60
    for part in range(parts):
        shade = colour((part + 0.5) / parts)
        place = (x + part / parts, y)
        axes.add_patch(Rectangle(place, 1.1 / parts, 0.13, facecolor=shade, linewidth=0))


def _small(axes: Axes, x: float, y: float, text: str, align: str = "left") -> None:
    axes.text(x, y, text, size=8, color=SOFT, ha=align, va="center")


def _success_legend(axes: Axes, x: float, y: float) -> None:
    from matplotlib.patches import Rectangle

    _small(axes, x, y, "0")
    _ramp(axes, x + 0.15, y - 0.065, success_colour)
    _small(axes, x + 1.2, y, "1")
    frame = (x + 1.5, y - 0.07)
    axes.add_patch(Rectangle(frame, 0.2, 0.14, fill=False, edgecolor=INK, linewidth=1.6))
    _small(axes, x + 1.78, y, "trained here     ▲ false pass     ▽ false fail")
    _small(axes, x, y + 0.24, "×n: episodes diverged. Pass: success of at least 0.5.")


def _energy_legend(axes: Axes, x: float, y: float, floor: float, largest: float) -> None:
    def colour(share: float) -> str:
        return _tint(WARM if share > 0.5 else COOL, abs(2.0 * share - 1.0))

    ends = compact(largest)
    _small(axes, x, y, f"−{ends} J")
    _ramp(axes, x + 0.62, y - 0.065, colour)
    _small(axes, x + 1.7, y, f"+{ends} J")
    _small(axes, x, y + 0.24, f"symmetric logarithm, linear below {compact(floor)} J")


# Gaps -------------------------------------------------------------------------------------------


def _gaps(panel: Panel) -> Figure | None:
    """Losses of success with intervals: the declared family, then the largest of the rest."""
    declared = list(panel.declared_gaps)
    others = list(panel.exploratory_gaps[:MAX_GAPS])
    lines = [*declared, *others]
    if not lines:
        return None
    pitch, left, width, top = 0.27, 4.9, 4.6, 1.05
    split = 0.45 if declared and others else 0.0
    tall = pitch * len(lines) + split
    figure = blank_figure(left + width + 1.9, top + tall + 0.85)
    high = float(figure.get_size_inches()[1])
    canvas = inch_canvas(figure)
    draw_heading(canvas, 0.3, "Transfer gaps", _gap_words(lines))
    axes = axes_at(figure, left, high - top - tall, width, tall)
    axes.set_ylim(tall, 0.0)
    _gap_frame(axes, [gap.value for gap in lines])
    for number, gap in enumerate(lines):
        y = pitch * (number + 0.5) + (split if number >= len(declared) else 0.0)
        _gap_line(axes, canvas, gap, y, (top + y, left, left + width))
    heads = [("declared family", 0.0, bool(declared))]
    hidden = len(panel.exploratory_gaps) - len(others)
    rest = f"exploratory, the {len(others)} largest" if hidden else "exploratory"
    heads.append((rest, pitch * len(declared) + split, bool(others)))
    for text, y, shown in heads:
        if shown:
            canvas.text(0.3, top + y - 0.07, text, size=8.5, color=SOFT, va="baseline")
    _small(canvas, left, high - 0.25, "loss of success; positive is worse")
    return figure


def _gap_words(gaps: Sequence[Gap]) -> str:
    text = (
        f"loss against policies trained there; band ±{EQUIVALENCE_MARGIN}, dashed line "
        f"{FAIL_MARGIN}; intervals over seeds, not adjusted"
    )
    return text + ("; * loss against home" if any(g.quantity == "home_drop" for g in gaps) else "")


def _gap_frame(axes: Axes, values: Sequence[Estimate]) -> None:
    axis = difference_axis(values)
    axes.set_xlim(axis.low - 0.03, axis.high + 0.03)
    axes.set_xticks(axis.ticks, [fixed(tick, 1) for tick in axis.ticks])
    axes.set_yticks([])
    axes.axvspan(-EQUIVALENCE_MARGIN, EQUIVALENCE_MARGIN, color=INK, alpha=0.07, linewidth=0)
    axes.axvline(0.0, color=SOFT, linewidth=0.8)
    axes.axvline(FAIL_MARGIN, color=VERDICT_COLOURS["fails"], linewidth=1.2, linestyle=(0, (4, 3)))
    bare(axes)


def _gap_line(
    axes: Axes, canvas: Axes, gap: Gap, y: float, place: tuple[float, float, float]
) -> None:
    colour = VERDICT_COLOURS.get(str(gap.verdict), SOFT) if gap.declared else SOFT
    low, high = gap.value.ends
    axes.plot([low, high], [y, y], color=colour, linewidth=1.6, solid_capstyle="butt")
    for end in (low, high):
        axes.plot([end, end], [y - 0.05, y + 0.05], color=colour, linewidth=1.2)
    face = colour if gap.declared else PAPER
    axes.plot(gap.value.estimate, y, "o", color=colour, markerfacecolor=face, markersize=6)
    down, left, right = place
    star = "*" if gap.quantity == "home_drop" else ""
    name = f"{plain(gap.row, 34)} → {plain(gap.cell, 34)}{star}"
    canvas.text(left - 0.15, down, name, size=8.5, color=INK, ha="right", va="center")
    numbers = f"{fixed(gap.value.estimate, 2, True)}"
    canvas.text(right + 0.15, down, numbers, size=8.5, color=INK, va="center", weight="bold")
    if gap.value.bounded:
        ends = f"{fixed(low)} to {fixed(high)}"
        canvas.text(right + 0.62, down, ends, size=8, color=SOFT, va="center")


# Perturbations ----------------------------------------------------------------------------------


def _checks(panel: Panel) -> Figure | None:
    """Success before and after every change of the plant or its delays."""
    blocks = [(label, found[:MAX_CHECKS]) for label, found in panel.checks.items()]
    if not blocks:
        return None
    pitch, left, width, top, split = 0.3, 4.6, 4.2, 0.95, 0.42
    tall = sum(split + pitch * len(found) for _, found in blocks)
    figure = blank_figure(left + width + 1.6, top + tall + 0.75)
    high = float(figure.get_size_inches()[1])
    canvas = inch_canvas(figure)
    about = "success with its interval over seeds: ring as specified, dot with the change"
    draw_heading(canvas, 0.3, "Perturbations and latency", about)
    axes = axes_at(figure, left, high - top - tall, width, tall)
    axes.set(xlim=(-0.02, 1.02), ylim=(tall, 0.0), yticks=[])
    axes.set_xticks([0.0, 0.25, 0.5, 0.75, 1.0], ["0", "0.25", "0.5", "0.75", "1"])
    axes.grid(axis="x", color=LINE, linewidth=0.7)
    axes.set_axisbelow(True)
    bare(axes)
    y = 0.0
    for label, found in blocks:
        y += split
        canvas.text(0.3, top + y - 0.1, plain(label), size=10, color=INK, weight="bold")
        for check in found:
            _check_line(axes, canvas, check, y + pitch / 2, (top + y + pitch / 2, left, width))
            y += pitch
    return figure


def _check_line(
    axes: Axes, canvas: Axes, check: Check, y: float, place: tuple[float, float, float]
) -> None:
    before = None if check.before is None else check.before.success
    after = check.after.success
    for value, shift, colour, face in (
        (before, -0.045, SOFT, PAPER),
        (after, 0.045, ACCENT, ACCENT),
    ):
        if value is not None:
            axes.plot(value.ends, [y + shift] * 2, color=colour, linewidth=1.5)
            axes.plot(
                value.estimate, y + shift, "o", color=colour, markerfacecolor=face, markersize=5.5
            )
    down, left, width = place
    cell = check.before.cell if check.before is not None else check.after.cell
    name = f"{plain(check.after.row.name, 29)} → {plain(cell.name, 29)}"
    canvas.text(left - 0.15, down, name, size=8.5, color=INK, ha="right", va="center")
    numbers = " → ".join(fixed(v.estimate) if v is not None else NONE for v in (before, after))
    canvas.text(left + width + 0.15, down, numbers, size=8.5, color=INK, va="center")


# Ladders ----------------------------------------------------------------------------------------


def _ladder(panel: Panel) -> Figure | None:
    """Success against the step: control period fixed on the left, following it on the right."""
    ladders = panel.ladders[:MAX_LADDERS]
    if not ladders:
        return None
    follows = any(ladder.following for ladder in ladders)
    names = dict.fromkeys(name for ladder in ladders for name in (*ladder.fixed, *ladder.following))
    schemes = {name: place for place, name in enumerate(names)}
    across = 2 if len(ladders) > 1 else 1
    plots = 2 if follows else 1
    down = math.ceil(len(ladders) / across)
    width, height, side, top = 2.55, 1.75, 0.62, 1.5
    unit = plots * (width + side) + 0.3
    figure = blank_figure(max(0.3 + across * unit, 6.9), top + down * (height + 1.02) + 0.1)
    high = float(figure.get_size_inches()[1])
    canvas = inch_canvas(figure)
    about = "success of the same policies as the step shrinks; finer to the right"
    about += "" if panel.truth is None else ", dashed: truth"
    draw_heading(canvas, 0.3, "Refinement ladder", about)
    scheme_legend(canvas, schemes, float(figure.get_size_inches()[0]))
    for number, ladder in enumerate(ladders):
        x = 0.3 + (number % across) * unit
        y = top + (number // across) * (height + 1.02)
        canvas.text(x, y - 0.02, plain(ladder.row.name), size=10, color=INK, weight="bold")
        for place, (words, rungs, truth) in enumerate(_ladder_plots(ladder)):
            if rungs:
                left = x + 0.42 + place * (width + side)
                axes = axes_at(figure, left, high - y - 0.32 - height, width, height)
                _ladder_axes(axes, rungs, schemes, truth, words)
    return figure


def _ladder_plots(ladder: Ladder) -> tuple[tuple[str, Any, Estimate | None], ...]:
    truth = None if ladder.truth is None else ladder.truth.success
    period = "" if ladder.control_period is None else f" at {step(ladder.control_period)} s"
    return (
        (f"control period fixed{period}", ladder.fixed, truth),
        ("control period follows the step", ladder.following, None),
    )


def _ladder_axes(
    axes: Axes,
    rungs: dict[str, tuple[Rung, ...]],
    schemes: dict[str, int],
    truth: Estimate | None,
    words: str,
) -> None:
    steps = sorted({rung.dt for line in rungs.values() for rung in line}, reverse=True)
    axes.set(ylim=(-0.04, 1.06), xlim=(-0.35, math.log2(steps[0] / steps[-1]) + 0.35))
    axes.set_yticks([0.0, 0.25, 0.5, 0.75, 1.0], ["0", "0.25", "0.5", "0.75", "1"])
    ticks = steps if len(steps) < 6 else steps[:: math.ceil(len(steps) / 5)]
    axes.set_xticks([math.log2(steps[0] / dt) for dt in ticks], [step(dt) for dt in ticks])
    axes.grid(axis="y", color=LINE, linewidth=0.7)
    axes.set_axisbelow(True)
    axes.set_title(words, size=8, color=SOFT, loc="left", pad=3)
    axes.set_xlabel("step, s", size=8, color=SOFT, labelpad=1)
    bare(axes)
    if truth is not None:
        axes.axhline(truth.estimate, color=INK, linewidth=1.3, linestyle=(0, (4, 3)), zorder=1.5)
    for name, line in rungs.items():
        _ladder_line(axes, line, schemes[name], len(schemes), steps[0])


def _ladder_line(axes: Axes, line: Sequence[Rung], place: int, count: int, coarsest: float) -> None:
    """One integrator, moved aside a little so that equal rates stay visible."""
    colour = SCHEME_COLOURS[place % len(SCHEME_COLOURS)]
    marker = SCHEME_MARKERS[place % len(SCHEME_MARKERS)]
    aside = (place - (count - 1) / 2.0) * 0.028
    rates = [rung.entry.success for rung in line]
    xs = [math.log2(coarsest / rung.dt) + aside for rung in line]
    known = [(x, rate) for x, rate in zip(xs, rates, strict=True) if rate is not None]
    for x, rate in known:
        axes.plot([x, x], rate.ends, color=colour, linewidth=1.1, alpha=0.45)
    axes.plot(
        [x for x, _ in known], [rate.estimate for _, rate in known], color=colour, marker=marker,
        linewidth=1.6, markersize=5, markeredgecolor=PAPER, markeredgewidth=0.6, clip_on=False,
    )  # fmt: skip


_FIGURES: Final[dict[str, Callable[[Panel], Figure | None]]] = {
    "success_matrix.png": _success,
    "transfer_gaps.png": _gaps,
    "energy_residual.png": _energy,
    "refinement_ladder.png": _ladder,
    "perturbations.png": _checks,
    "remedy.png": draw_remedy,
}
