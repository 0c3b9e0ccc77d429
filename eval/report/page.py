"""The pages of a panel and of a judgement: one file that opens offline.

A panel's has its films and a simulation in it.
"""

from __future__ import annotations

import json
import re
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from datetime import UTC
from functools import cache, partial
from importlib import resources
from os import PathLike
from pathlib import Path
from typing import Any, Final
from urllib.parse import quote

from integ_gym.evidence.sealing import read_valid_seal
from integ_gym.support.figures import MARKERS, VIRIDIS
from integ_gym.support.files import replace_file
from integ_gym.support.optional import load, package_version
from integ_gym.support.pages import page_environment, page_parts
from integ_gym.support.terminal import fixed, nonbreaking, plural, seconds, true_minus

from .. import verdict as rules
from ..judge import STATUS_WORDS, Compared, Judgement, answer_of, limitations
from ..panel import conclusions
from ..panel.result import Failure, Panel
from ..result_files import MEASURES
from ..statistics import Estimate
from ..verdict import PolicyComparison
from . import forests
from .episodes import Episodes, read_episodes
from .findings import findings_of
from .ladders import Series, ladder_plots, sweep_plots
from .matrices import shade_style, success_matrix
from .payload import LABEL_WORDS, pack_payload, quote_command
from .task import describe_task, panel_setup, target_script

FILE_NAME: Final = "report.html"
"""Name of the report in a panel's directory."""

SHOWN_FINDINGS: Final = 7
"""Conclusions that are shown at once; the others are one click away."""

SIGNS: Final = {"fails": "✕", "transfers": "✓", "inconclusive": "?"}
"""Signs of verdicts, whose names are those of their colours, too."""

_OUTCOME_TONES: Final[dict[str, forests.Tone]] = {
    "accepted": "transfers", "rejected": "fails", "uninformative": "inconclusive",
}  # fmt: skip
_ROLES: Final = {"quarter_step": "dt/4", "reference": "truth"}
_LEFT, _TOP, _RIGHT, _BOTTOM = 36.0, 12.0, 286.0, 176.0
"""Edges of a ladder's axes, in a frame of 300 by 212."""

_LINE, _MARKER = 2.6, 5.2
"""Width of a line and radius of a marker there."""


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
    html = render(panel, read_episodes(panel, directory), read_valid_seal(Path(directory)))
    return replace_file(Path(directory) / FILE_NAME, html.encode())


def render(panel: Panel, episodes: Episodes | None = None, seal: str | None = None) -> str:
    """The report's HTML.

    Parameters
    ----------
    panel
        What ``panel.json`` holds.
    episodes
        Single episodes from the evidence, if there is any.
    seal
        The hash that pins the run, which the page quotes and does not belong to.

    Raises
    ------
    ModuleNotFoundError
        As `write_report`.
    """
    trusts, task = forests.trust_of(panel), describe_task(panel)
    success, returns = forests.paired_success(panel), forests.paired_return(panel)
    rows = [row for row in panel.rows if not row.baseline]
    text: str = (
        report_environment()
        .get_template("report.html.j2")
        .render(
            **page_parts("".join(_files("sheets").values()), _script(panel, episodes)),
            panel=panel,
            seal=seal,
            created=f"{panel.created.astimezone(UTC):%Y-%m-%d %H:%M} UTC",
            headline=_headline(panel),
            details=conclusions.answer_lines(panel)[1:],
            next_step=conclusions.next_step(panel),
            task=task,
            has_episodes=episodes is not None,
            leads=episodes.leads if episodes else (),
            watch_title=_watch_title(episodes),
            watch_words=_watch_words(panel, episodes),
            carried=pack_payload(panel, episodes, task, _href),
            tiles=_tiles(panel, trusts),
            success=success_matrix(panel),
            verdicts=forests.ordered_verdicts(panel),
            gaps=forests.gap_forest(panel),
            paired=list(filter(None, (success, returns) if panel.truth else (returns, success))),
            remedies=forests.mixtures_of(panel),
            engine_lines=sorted(panel.engine_agreement, key=lambda e: (e.map, e.engine, -e.dt)),
            costs=[
                (row, panel.training_costs[row.name], panel.on_yardstick(row.name))
                for row in panel.ordered_rows
                if row.name in panel.training_costs
            ],
            ladders=ladder_plots(panel),
            sweeps=sweep_plots(panel),
            checks=forests.check_forest(panel),
            separations=conclusions.separations_by_measure(panel),
            trust=trusts,
            rankings=sorted(panel.rankings, key=lambda one: -one.violation.estimate),
            findings=findings_of(panel, trusts),
            failed=_count_failures(panel),
            failures=_failures(panel),
            place_of=partial(_place_of_episode, panel),
            comparisons=[(one, *_comparison(one)) for one in panel.policy_comparisons],
            fewest=None if panel.given_alone or not rows else min(row.seeds for row in rows),
            unlearned=[panel.in_words(row.name) for row in rows if row.learned is False],
            settings=_settings(panel),
            applied=Counter(cell.applied for cell in panel.cells if cell.applied).items(),
            spec_json=json.dumps(panel.spec, indent=2, ensure_ascii=False),
        )
    )
    return text


@cache
def report_environment() -> Any:
    """The jinja2 environment of a panel's page: its parts, filters and words."""
    context, markup = load("jinja2", "report").pass_context, load("markupsafe", "report")

    def breakable(text: str) -> Any:
        return markup.Markup(str(markup.escape(text)).replace("_", "_<wbr>"))

    def quote_value(text: Any) -> Any:
        return markup.Markup(re.sub("`([^`]+)`", r"<code>\1</code>", str(text)))

    environment = page_environment(_files("parts"))
    environment.filters.update(
        called=context(lambda given, name: breakable(given["panel"].label(str(name)))),
        said=lambda text: quote_value(breakable(nonbreaking(str(text)))),
        href=_href,
        along=_along,
        across=_across,
        up=_up,
        corners=_corners,
        shading=shade_style,
        true_minus=true_minus,
        p_text=rules.p_text,
    )
    environment.globals.update(
        rules=rules,
        frame={"LEFT": _LEFT, "TOP": _TOP, "RIGHT": _RIGHT, "BOTTOM": _BOTTOM},
        rate_axis=forests.RATE_AXIS,
        signs=SIGNS,
        outcome_tones=_OUTCOME_TONES,
        verdict_order=forests.VERDICT_ORDER,
        label_words=LABEL_WORDS,
        shown_findings=SHOWN_FINDINGS,
        ramp=", ".join(f"#{stop}" for stop in VIRIDIS),
        mark=forests.Mark,
        verdict_reason=conclusions.verdict_reason,
        comparison_reason=conclusions.comparison_reason,
        cost_words=conclusions.cost_words,
        plural=plural,
        quote_command=quote_command,
    )
    return environment


@cache
def _files(folder: str) -> dict[str, str]:
    """Text of the files in a folder beside this module, by name."""
    files = sorted(resources.files(__package__).joinpath(folder).iterdir(), key=lambda f: f.name)
    return {file.name: file.read_text("utf-8") for file in files}


def _script(panel: Panel, episodes: Episodes | None) -> str:
    """Start and step of every simulated cell, by its place, and the place of what moves by itself.

    Then all files, `main.js` last.
    """
    scripts = episodes.live.scripts if episodes and episodes.live else {}
    places = panel.cell_places
    steps = [f"{places[name]}: [{start},\n{step}],\n" for name, (start, step) in scripts.items()]
    files = dict(_files("script"))
    main = files.pop("main.js")
    setup = panel_setup(panel)
    target = setup and target_script(setup)
    whole = (
        f"const STEPS = {{\n{''.join(steps)}}};",
        f"const TARGET = {target or 'null'};",
        *files.values(),
        main,
    )
    return "(() => {{\n{}}})();\n".format("\n".join(whole))


def _href(path: str) -> str:
    """A link to a file of the panel, always relative to the report."""
    return "./" + quote(path.replace("\\", "/").lstrip("/"), safe="/=")


def _along(axis: forests.Axis, value: float) -> float:
    """Place of a value on an axis, in percent of the width."""
    return round(100.0 * axis.share(value), 2)


def _across(share: float, series: Series | None = None) -> float:
    """Place of a step in a ladder's plot, moved aside as its series is."""
    aside = 0.0 if series is None else series.aside * _LINE
    return round(_LEFT + 22.0 + share * (_RIGHT - _LEFT - 40.0) + aside, 1)


def _up(rate: float) -> float:
    """Place of a rate in a ladder's plot."""
    return round(_BOTTOM - min(max(rate, 0.0), 1.0) * (_BOTTOM - _TOP), 1)


def _corners(marker: str) -> str:
    """A marker about the origin, as the points of a polygon."""
    return " ".join(f"{_MARKER * x:.1f},{-_MARKER * y:.1f}" for x, y in MARKERS[marker])


def _headline(panel: Panel) -> tuple[str, str]:
    """The first line of the answer, its conclusion apart from the numbers before it."""
    line = conclusions.answer_lines(panel)[0]
    numbers, colon, conclusion = line.rpartition(": ")
    return (numbers + colon, conclusion) if conclusions.finding_of(panel) and colon else (line, "")


def _watch_title(episodes: Episodes | None) -> str:
    """Whether a policy is seen to hold first, or to fail elsewhere from a start of its success."""
    if episodes and episodes.leads and episodes.leads[0].kind == "held":
        keys = episodes.leads[0].keys if episodes.skeleton else ()
        won = [t.fields["failure_label"] == "none" for t in episodes.traces if t.key in keys]
        return "Watch it hold" if all(won) else "Watch it hold, and fall"
    ends = defaultdict(set)
    for trace in episodes.traces if episodes else ():
        row, _, seed, episode = trace.key
        ends[row, seed, episode].add(trace.fields["failure_label"] == "none")
    return "Watch it fail" if {True, False} in ends.values() else "Watch it"


def _watch_words(panel: Panel, episodes: Episodes | None) -> str:
    """What of the motions is recorded, and what is recomputed."""
    if episodes is None or episodes.live is None:
        return "These are recorded episodes."
    scripts = episodes.live.scripts
    left_out = [cell.name for cell in panel.columns if cell.name not in scripts]
    policies = plural(len(episodes.live.policies), "policy", "policies")
    only = f"; recorded only: {', '.join(left_out)}" if left_out else ""
    return (
        "Episodes are recorded; move the start, and this browser recomputes them by the equations "
        f"that made the records ({policies}, {plural(len(scripts), 'discretization')}){only}."
    )


def _tiles(panel: Panel, trusts: Sequence[forests.Trust]) -> list[tuple[str, str]]:
    """Headline counts: (number, what it counts)."""
    trained = [row for row in panel.rows if row.kind == "trained"]
    mixtures = sum(row.mixed for row in trained)
    policies = sum(row.seeds for row in panel.rows if row.kind != "baseline")
    grid = sum(cell.column for cell in panel.cells)
    checks = len(panel.cells) - grid
    work = "to train and evaluate" if trained else "to evaluate"
    if trained and not panel.cost.train_seconds:
        work = "to evaluate policies that another run trained"
    tiles = []
    if trained:
        more = f" and {plural(mixtures, 'mixture')}" if mixtures else ""
        tiles.append((f"{len(trained) - mixtures}", f"training discretizations{more}"))
    more = f", and {plural(checks, 'cell')} for checks" if checks else ""
    tiles += [
        (f"{policies}", "policies" if policies != 1 else "policy"),
        (f"{grid}", f"evaluation discretizations{more}"),
        (f"{sum(e.episodes for e in panel.matrix):,}", "episodes, each on record"),
    ]
    if trusts:
        wrong = sum(entry.contradicted for trust in trusts for entry in trust.judged)
        tiles.append((f"{wrong}", f"pass/fail results that the {panel.yardstick_name} contradicts"))
    return [*tiles, (seconds(panel.cost.wall_seconds), work)]


def _place_of_episode(
    panel: Panel, row: str, cell: str, policy: str | None, episode: int
) -> str | None:
    """Where the page shows an episode; None if it does not."""
    anchor, policies = panel.anchor(row, cell), [one.id for one in panel.row(row).policies]
    if anchor is None or policy not in policies:
        return None
    return f"{anchor}s{policies.index(policy)}e{episode}"


def _count_failures(panel: Panel) -> dict[str, Any] | None:
    """Failures of policies that are no baselines: their labels, and counts of those by row."""
    counts = {row.name: Counter[str]() for row in panel.ordered_rows if not row.baseline}
    for entry in panel.matrix:
        if entry.row in counts:
            counts[entry.row].update({k: n for k, n in entry.labels.items() if k != "none"})
    counts = {row: own for row, own in counts.items() if own.total()}
    found = {label for own in counts.values() for label in own}
    labels = [*(label for label in LABEL_WORDS if label in found), *sorted(found - {*LABEL_WORDS})]
    total = sum(own.total() for own in counts.values())
    return {"labels": labels, "rows": counts, "total": total} if counts else None


def _failures(panel: Panel) -> list[tuple[str, list[Failure]]]:
    """The sample of failing episodes by label, those that are most first."""
    by_label = defaultdict(list)
    for failure in panel.failures:
        by_label[failure.label].append(failure)
    return sorted(by_label.items(), key=lambda pair: -len(pair[1]))


def _comparison(compared: PolicyComparison) -> tuple[list[forests.Line], forests.Axis]:
    """Success of one policy minus that of another in every cell."""
    lines = [
        forests.Line(
            "",
            cell.name,
            (compared.a, cell.name),
            (forests.Mark(cell.difference, _OUTCOME_TONES[compared.outcome]),),
            fixed(cell.difference.estimate, 2, True),
            cell.status.replace("_", " "),
            f"A − B {cell.difference}",
            _ROLES.get(cell.role or "", ""),
        )
        for cell in compared.cells
    ]
    return lines, forests.difference_axis([cell.difference for cell in compared.cells], 0.5)


def _settings(panel: Panel) -> list[tuple[str, str]]:
    """Entries of the spec that are plain values, and the arguments of environment and training."""

    def plain(value: Any) -> str:
        if isinstance(value, list):
            return ", ".join(map(plain, value))
        if isinstance(value, bool | Mapping):
            return json.dumps(value)
        return "none" if value is None else str(value)

    def is_plain(value: Any) -> bool:
        if isinstance(value, list):
            return bool(value) and not any(isinstance(x, list | Mapping) for x in value)
        return not isinstance(value, Mapping)

    pairs = [pair for pair in panel.spec.items() if is_plain(pair[1])]
    for group in ("environment", "training"):
        pairs += panel.spec.get(group, {}).items()
    return [(str(name), plain(value)) for name, value in pairs]


def render_judgement(found: Judgement, command: str) -> str:
    """The page of a judgement: one HTML file that opens offline.

    Raises:
        ModuleNotFoundError: if jinja2 is not installed, with the command that installs it.
    """
    page: str = report_environment().get_template("judge.html.j2").render(
        **page_parts(),
        answer=answer_of(found),
        forests=list(_judgement_forests(found)),
        limitations=limitations(found),
        command=command,
        version=package_version("integ-gym"),
    )  # fmt: skip
    return page


def _judgement_forests(found: Judgement) -> Iterator[tuple[str, forests.Axis, list[forests.Line]]]:
    """Title, axis and lines of each figure of the page."""
    for name in MEASURES:
        judged = [one for one in found.judged if name in one.estimates]
        values = [one.estimates[name] for one in judged]
        lines = [
            _judgement_line(one.policy, one.condition, value,
                  f"{plural(one.seeds, 'seed')}, {plural(one.episodes, 'episode')}")
            for one, value in zip(judged, values, strict=True)
        ]  # fmt: skip
        yield (
            name.title(),
            forests.RATE_AXIS if name == "success" else forests.value_axis(values),
            lines,
        )
        axis = forests.difference_axis if name == "success" else forests.value_axis
        for title, group in (("Lost from home", found.losses), ("Policies", found.policies)):
            own = [one for one in group if one.measure == name]
            lines = [
                _judgement_line(
                    one.place, f"{one.first} − {one.second}", one.difference, _difference_note(one)
                )
                for one in own
            ]
            yield f"{title}: {name}", axis([one.difference for one in own]), lines


def _difference_note(one: Compared) -> str:
    split = {"difficulty": one.difficulty, "rest": one.rest}
    parts = [f"{name} {value}" for name, value in split.items() if value]
    return ", ".join([STATUS_WORDS[one.status], rules.p_text(one.p_adjusted), *parts])


def _judgement_line(row: str, cell: str, value: Estimate, note: str) -> forests.Line:
    ends = " to ".join(map(fixed, value.ends)) if value.bounded else ""
    return forests.Line(
        row, cell, (row, cell), (forests.Mark(value, "accent"),), fixed(value.estimate), ends,
        f"{row}, {cell}: {value}", note,
    )  # fmt: skip
