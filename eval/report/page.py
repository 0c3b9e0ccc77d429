"""Headline counts of a panel."""

from __future__ import annotations

import json
from collections.abc import Sequence
from datetime import UTC
from functools import cache
from importlib import resources
from os import PathLike
from pathlib import Path
from typing import Any, Final
from urllib.parse import quote

from integ_gym.evidence.sealing import unbroken_seal
from integ_gym.support.figures import VIRIDIS
from integ_gym.support.files import replace_file
from integ_gym.support.pages import page_environment, page_parts
from integ_gym.support.terminal import plural, seconds, true_minus

from .. import verdict as rules
from ..panel.conclusions import answer_lines, finding_of, next_step
from ..panel.result import Panel
from . import placing as drawing
from .cards import (
    LABEL_WORDS,
    applied_of,
    card_of,
    carried_by,
    comparison_of,
    failure_table,
    failures_of,
    limits_of,
    naming_filters,
    settings_of,
    tally_of,
)
from .episodes import Told, task_words, told_by
from .findings import findings_of
from .forests import (
    Trust,
    check_forest,
    costs_of,
    gap_forest,
    mixtures_of,
    ordered_verdicts,
    paired_return,
    paired_success,
    trust_of,
)
from .ladders import ladder_plots, sweep_plots
from .matrices import RATE_AXIS, success_matrix


def tiles_of(panel: Panel, trusts: Sequence[Trust]) -> list[tuple[str, str]]:
    """Headline counts: (number, what it counts)."""
    trained = [row for row in panel.rows if row.kind == "trained"]
    policies = sum(row.seeds for row in panel.rows if row.kind != "baseline")
    wrong = [e for t in trusts for e in t.judged if e.contradicted]
    discretizations = sum(cell.kind in ("grid", "reference") for cell in panel.cells)
    checks = len(panel.cells) - discretizations
    more_cells = f", and {plural(checks, 'cell')} for checks" if checks else ""
    tiles = []
    if trained:
        mixtures = sum(row.mixed for row in trained)
        more = f" and {plural(mixtures, 'mixture')}" if mixtures else ""
        tiles.append((f"{len(trained) - mixtures}", f"training discretizations{more}"))
    tiles += [
        (f"{policies}", "policies" if policies != 1 else "policy"),
        (f"{discretizations}", f"evaluation discretizations{more_cells}"),
        (f"{sum(e.episodes for e in panel.matrix):,}", "episodes, each on record"),
    ]
    if trusts:
        tiles.append((f"{len(wrong)}", "answers the truth contradicts"))
    tiles.append((seconds(panel.cost.wall_seconds), _work(panel, bool(trained))))
    return tiles


def _work(panel: Panel, trained: bool) -> str:
    """What the run's time was spent on."""
    if not trained:
        return "to evaluate"
    if not panel.cost.train_seconds:
        return "to evaluate policies that another run trained"
    return "to train and evaluate"


FILE_NAME: Final = "report.html"
"""Name of the report in a panel's directory."""

SHOWN_FINDINGS: Final = 7
"""Conclusions that are shown at once; the others are one click away."""


def write_report(panel: Panel, directory: str | PathLike[str]) -> Path:
    """Write ``report.html`` into a panel's directory.

    Parameters
    ----------
    panel
        What ``panel.json`` holds.
    directory
        The panel's directory; made if it does not exist.

    Returns
    -------
    Path of the file, which is complete as soon as it is there.

    Raises
    ------
    ModuleNotFoundError
        If jinja2 is not installed, with the command that installs it.
    """
    html = render(panel, told_by(panel, directory), unbroken_seal(Path(directory)))
    return replace_file(Path(directory) / FILE_NAME, html.encode())


def render(panel: Panel, told: Told | None = None, seal: str | None = None) -> str:
    """The report's HTML.

    Parameters
    ----------
    panel
        What ``panel.json`` holds.
    told
        What the evidence tells of single episodes, if there is any.
    seal
        The hash that pins the run, which the page quotes and does not belong to.

    Raises
    ------
    ModuleNotFoundError
        As `write_report`.
    """
    text: str = _template().render(_context(panel, told), seal=seal)
    return text


@cache
def _template() -> Any:
    own = resources.files(__package__)
    parts = own.joinpath("parts").iterdir()
    environment = page_environment({part.name: part.read_text("utf-8") for part in parts})
    environment.filters.update(
        href=_href,
        along=drawing.along,
        across=drawing.across,
        up=drawing.up,
        corners=drawing.corners,
        shading=drawing.shading,
        true_minus=true_minus,
        **naming_filters(),
    )
    return environment.get_template("report.html.j2")


def _own_parts(panel: Panel, told: Told | None) -> dict[str, Any]:
    """Style and script of this page; the steps that it takes come first, and `main.js` last."""
    scripts = dict(_texts("script"))
    main = scripts.pop("main.js")
    script = "\n".join((_steps(panel, told), *scripts.values(), main))
    return page_parts("".join(_texts("sheets").values()), f"(() => {{\n{script}}})();\n")


def _steps(panel: Panel, told: Told | None) -> str:
    """Start and step of every cell that is simulated, by its place."""
    scripts = told.live.scripts if told and told.live else {}
    places = {cell.name: place for place, cell in enumerate(panel.cells)}
    lines = [f"{places[name]}: [{start},\n{step}],\n" for name, (start, step) in scripts.items()]
    return f"const STEPS = {{\n{''.join(lines)}}};"


@cache
def _texts(folder: str) -> dict[str, str]:
    """Files by name, those of folders within first."""
    entries = sorted(resources.files(__package__).joinpath(folder).iterdir(), key=lambda e: e.name)
    inner: dict[str, str] = {}
    for entry in entries:
        inner |= _texts(f"{folder}/{entry.name}") if entry.is_dir() else {}
    return inner | {entry.name: entry.read_text("utf-8") for entry in entries if entry.is_file()}


def _context(panel: Panel, told: Told | None) -> dict[str, Any]:
    trusts = trust_of(panel)
    task = task_words(panel)
    leads = told.leads if told else ()
    cards = [card_of(panel, judged) for judged in ordered_verdicts(panel)]
    return {
        **_own_parts(panel, told),
        "panel": panel,
        "created": f"{panel.created.astimezone(UTC):%Y-%m-%d %H:%M} UTC",
        "headline": _headline(panel),
        "details": answer_lines(panel)[1:],
        "next_step": next_step(panel),
        "task": task,
        "leads": leads,
        "watch_title": _watch_title(told),
        "watch_words": _watch_words(panel, told),
        "carried": carried_by(panel, told, task, _href),
        "tiles": tiles_of(panel, trusts),
        "success": success_matrix(panel),
        "cards": cards,
        "tally": tally_of(cards),
        "gaps": gap_forest(panel),
        "paired": _paired(panel),
        "remedies": mixtures_of(panel),
        "engine_lines": sorted(
            panel.engine_agreement, key=lambda one: (one.map, one.engine, -one.dt)
        ),
        "costs": costs_of(panel),
        "rate_axis": RATE_AXIS,
        "ladders": ladder_plots(panel),
        "sweeps": sweep_plots(panel),
        "checks": check_forest(panel),
        "frame": drawing,
        "trust": trusts,
        "rankings": sorted(panel.rankings, key=lambda one: -one.violation.estimate),
        "findings": findings_of(panel, trusts),
        "failure_table": failure_table(panel),
        "failures": failures_of(panel, told),
        "comparisons": [comparison_of(one) for one in panel.policy_comparisons],
        "limits": limits_of(panel),
        "settings": settings_of(panel),
        "applied": applied_of(panel),
        "spec_json": json.dumps(panel.spec, indent=2, ensure_ascii=False),
        "rules": rules,
        "pass_line": rules.PASS,
        "label_words": LABEL_WORDS,
        "shown_findings": SHOWN_FINDINGS,
        "ramp": ", ".join(f"#{stop}" for stop in VIRIDIS),
        "plural": plural,
    }


def _headline(panel: Panel) -> tuple[str, str]:
    """The first line of the answer, its conclusion apart from the numbers before it."""
    line = answer_lines(panel)[0]
    numbers, colon, conclusion = line.rpartition(": ")
    return (numbers + colon, conclusion) if finding_of(panel) and colon else (line, "")


def _paired(panel: Panel) -> list[Any]:
    """Given policies held against themselves, what tells more first."""
    success, earned = paired_success(panel), paired_return(panel)
    both = (success, earned) if panel.truth is not None else (earned, success)
    return [forest for forest in both if forest is not None]


def _watch_title(told: Told | None) -> str:
    """Whether a policy is seen to hold first, or to fail elsewhere from a start of its success."""
    if told and told.leads and told.leads[0].kind == "held":
        return "Watch it hold"
    ends: dict[tuple[str, int, int], set[bool]] = {}
    for trace in told.traces if told else ():
        row, _, seed, episode = trace.key
        ends.setdefault((row, seed, episode), set()).add(trace.fields["failure_label"] == "none")
    return "Watch it fail" if {True, False} in ends.values() else "Watch it"


def _watch_words(panel: Panel, told: Told | None) -> str:
    """What of the motions is recorded, and what is recomputed."""
    if told is None or told.live is None:
        return "These are recorded episodes."
    left_out = [cell.name for cell in panel.columns if cell.name not in told.live.scripts]
    policies = plural(len(told.live.policies), "policy", "policies")
    words = (
        "Episodes are recorded; move the start, and this browser recomputes them by the equations "
        f"that made the records ({policies}, {plural(len(told.live.scripts), 'discretization')})"
    )
    return f"{words}; recorded only: {', '.join(left_out)}." if left_out else f"{words}."


def _href(path: str) -> str:
    """A link to a file of the panel, always relative to the report."""
    return "./" + quote(path.replace("\\", "/").lstrip("/"), safe="/=")
