"""What the page shows, as data for its template and script."""

from __future__ import annotations

import json
import re
import shlex
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final, TypeAlias

from integ_gym.support.optional import load
from integ_gym.support.terminal import (
    compact,
    fixed,
    percent,
    plural,
    step,
    together,
    true_minus,
)

from ..film import LEAST_START
from ..panel.result import (
    AppliedDiscretization,
    CellFinding,
    Entry,
    Estimate,
    Failure,
    Panel,
    PolicyComparison,
    Verdict,
)
from ..verdict import (
    EQUIVALENCE_MARGIN,
    FAIL_MARGIN,
    LEARNED,
    MIN_SEEDS,
    p_text,
)
from .episodes import TaskWords, Told, chosen_words
from .forests import (
    VERDICT_ORDER,
    Line,
    Mark,
    Tone,
)
from .matrices import (
    CLASS_WORDS,
    Matrix,
    difference_axis,
    energy_matrix,
    loss_matrix,
    mean_words,
    return_matrix,
    solved_words,
    success_matrix,
    time_matrix,
)
from .payload import packed
from .placing import shading

_PLAIN = re.compile(r"[\w@%+=:,./-]+", re.ASCII)


def readable(words: Sequence[str]) -> str:
    """A command line of these words, in double quotes where a word holds single ones."""
    return " ".join(map(_quoted, words))


def _quoted(word: str) -> str:
    if _PLAIN.fullmatch(word):
        return word
    if "'" in word and not re.search(r'["$`\\!]', word):
        return f'"{word}"'
    return shlex.quote(word)


Filter: TypeAlias = Callable[[Any, Any], Any]
"""Of a template: from its context and a value."""


def naming_filters() -> dict[str, Filter]:
    """Filters of templates that are told of a ``panel``: names and sentences, breakable."""
    told: Callable[[Filter], Filter] = load("jinja2", "report").pass_context
    markup = load("markupsafe", "report")

    def breakable(text: str) -> Any:
        return markup.Markup(str(markup.escape(text)).replace("_", "_<wbr>"))

    @told
    def shown_name(context: Any, name: Any) -> Any:
        return breakable(context["panel"].called(str(name)))

    @told
    def shown_text(context: Any, text: Any) -> Any:
        return breakable(together(context["panel"].said(str(text))))

    @told
    def plain_text(context: Any, text: Any) -> Any:
        return context["panel"].said(str(text))

    return {"called": shown_name, "said": shown_text, "said_plain": plain_text}


LABEL_WORDS: Final = {
    "evaluation_error": "simulator or metric broke",
    "unachievable": "a search over controls misses the goal's energy from most starts",
    "not_learned": "the policy fails at home, too",
    "too_slow": "succeeds from the same start in twice the time",
    "discretization_error": "succeeds from the same start at home",
    "perception_error": "succeeds without sensor noise",
    "state_error": "succeeds without delay or staleness",
    "control_error": "saturated, or left the goal after reaching it",
    "planning_error": "never reached the goal, unsaturated",
    "unattributed": "a needed replay was not run",
}
"""Failure labels in words, in the order in which their rules are tried."""


def failure_table(panel: Panel) -> dict[str, Any] | None:
    """Failures of policies that are no baselines, by row and label, with shares of the row's."""
    rows = [row.name for row in panel.ordered_rows if not row.baseline]
    by_row: dict[str, Counter[str]] = {row: Counter() for row in rows}
    for entry in panel.matrix:
        if entry.row in by_row:
            by_row[entry.row].update(entry.labels)
    for counts in by_row.values():
        counts.pop("none", None)
    failed = {row: counts for row, counts in by_row.items() if counts.total()}
    if not failed:
        return None
    found = {name for counts in failed.values() for name in counts}
    names = [*(name for name in LABEL_WORDS if name in found), *sorted(found - set(LABEL_WORDS))]
    lines = []
    for row, counts in failed.items():
        shares = [(counts[name], counts[name] / counts.total()) for name in names]
        lines.append({"row": row, "total": counts.total(), "shares": shares})
    return {"labels": names, "lines": lines, "total": sum(c.total() for c in failed.values())}


def failures_of(panel: Panel, told: Told | None = None) -> list[dict[str, Any]]:
    """The sample of failing episodes, by label, each with what shows it.

    That is a place on this page if it carries the episode, or else a command.
    """
    by_label: dict[str, list[dict[str, Any]]] = {}
    for failure in panel.failures:
        words = ("integ-gym", "evidence", "show", panel.directory, failure.record_id)
        record = {
            "failure": failure,
            "episode": _episode(panel, failure) if told else None,
            "command": readable(words),
        }
        by_label.setdefault(failure.label, []).append(record)
    labels = sorted(by_label, key=lambda name: -len(by_label[name]))
    return [{"label": label, "records": by_label[label]} for label in labels]


def _episode(panel: Panel, failure: Failure) -> str | None:
    """Where the page shows an episode."""
    anchor = panel.anchor(failure.row, failure.cell)
    policies = [policy.id for policy in panel.row(failure.row).policies]
    if anchor is None or failure.policy not in policies:
        return None
    return f"{anchor}s{policies.index(failure.policy)}e{failure.episode_index}"


_ROLES = {"quarter_step": "dt/4", "reference": "truth"}
_TONES: dict[str, Tone] = {
    "accepted": "transfers", "rejected": "fails", "uninformative": "inconclusive",
}  # fmt: skip
_SIGNS = {"accepted": "✓", "rejected": "✕", "uninformative": "?"}

_VERDICTS: dict[str, tuple[str, Tone]] = {
    "fails": ("✕", "fails"),
    "transfers": ("✓", "transfers"),
    "inconclusive": ("?", "inconclusive"),
}
"""Sign and colour of a verdict."""

_WITHOUT: tuple[str, Tone] = ("○", "not_learned")
_WORTH_TELLING = 0.1
"""Loss of success of a single seed that is named."""

_PARTS = ("difficulty", "deadline", "overfitting")


def card_of(panel: Panel, judged: Verdict) -> dict[str, Any]:
    """One verdict of the declared family."""
    p_values = [
        (f"overfitting > {FAIL_MARGIN}", judged.p_exceeds_adjusted),
        (f"overfitting within ±{EQUIVALENCE_MARGIN}", judged.p_equivalent_adjusted),
    ]
    sign, tone = _VERDICTS.get(judged.verdict, _WITHOUT)
    return {
        "judged": judged,
        "sign": sign,
        "word": _words(judged.verdict),
        "tone": tone,
        "parts": [(part, _signed(getattr(judged, part))) for part in _PARTS],
        "total": _signed(judged.total),
        "marks": [Mark(judged.overfitting, tone)] if judged.verdict in _VERDICTS else [],
        "reason": true_minus(judged.reason),
        "tail": _tail(panel, judged),
        "wanted": judged.seeds_wanted,
        "p_values": [(words, p_text(p)) for words, p in p_values if p is not None],
    }


def _tail(panel: Panel, judged: Verdict) -> dict[str, Any] | None:
    """How many seeds lose most of their success, and where the worst one's episodes are."""
    entry = panel.entry(judged.row, judged.cell)
    if entry is None or entry.tail is None or entry.worst_policy is None:
        return None
    ids = [policy.id for policy in panel.row(judged.row).policies]
    return {
        "share": entry.tail,
        "policy": entry.worst_policy,
        "loss": fixed(entry.worst_loss),
        "told": (entry.worst_loss or 0.0) >= _WORTH_TELLING,
        "place": f"{panel.anchor(judged.row, judged.cell)}s{ids.index(entry.worst_policy)}e0",
        "numerics": entry.numerics_share,
    }


def tally_of(cards: Sequence[dict[str, Any]]) -> list[tuple[str, int, str]]:
    """Tone, number and words of every verdict; of those that are none, only if there are some."""
    counts = Counter(card["judged"].verdict for card in cards)
    return [
        (_VERDICTS.get(name, _WITHOUT)[1], counts[name], _words(name))
        for name in VERDICT_ORDER
        if counts[name] or name in _VERDICTS
    ]


def comparison_of(compared: PolicyComparison) -> dict[str, Any]:
    """One comparison of two policies."""
    tone = _TONES[compared.outcome]
    return {
        "compared": compared,
        "tone": tone,
        "sign": _SIGNS[compared.outcome],
        "reason": true_minus(compared.reason),
        "lines": [_line(compared, cell, tone) for cell in compared.cells],
        "axis": difference_axis([cell.difference for cell in compared.cells], 0.5),
    }


def _words(verdict: str) -> str:
    return verdict.replace("_", " ")


def _signed(value: Estimate) -> str:
    return fixed(value.estimate, 2, True)


def _line(compared: PolicyComparison, cell: CellFinding, tone: Tone) -> Line:
    return Line(
        "",
        cell.name,
        (compared.a, cell.name),
        (Mark(cell.difference, tone),),
        fixed(cell.difference.estimate, 2, True),
        cell.status.replace("_", " "),
        f"A − B {cell.difference}",
        _ROLES.get(cell.role or "", ""),
    )


def limits_of(panel: Panel) -> list[str]:
    """What this panel cannot say, from its own numbers."""
    rows = [row for row in panel.rows if not (row.baseline or panel.given_alone)]
    fewest = min((row.seeds for row in rows), default=0)
    limits = []
    if rows and fewest < MIN_SEEDS:
        limits.append(
            f"Some rows have {plural(fewest, 'seed')}; below {MIN_SEEDS} seeds nothing is "
            "concluded, whatever the numbers look like."
        )
    if rows and fewest < 30:
        limits.append(
            "Showing that a policy transfers takes many seeds: with every rate at 1.0, 30 a side "
            "in a family of one and 47 in a family of six. "
            f"Here the rows have {fewest} or more, so inconclusive is not the same as fails."
        )
    if panel.truth is None:
        limits.append("There is no truth column, so no class against the truth.")
    unlearned = [row.name for row in rows if row.learned is False]
    if unlearned:
        limits.append(
            f"Not learned, hence without a verdict: {', '.join(unlearned)} (home success below "
            f"{LEARNED})."
        )
    limits += panel.protocol_gaps
    if panel.given_alone:
        return [*limits, "Another seed of the same training could do otherwise."]
    limits.append(
        "Everything outside the declared family is exploratory: its intervals are not adjusted "
        "for how many there are."
    )
    return limits


def applied_of(panel: Panel) -> list[tuple[AppliedDiscretization, int]]:
    """What environments really did, each with the number of cells that it goes for, as in it."""
    found = Counter(cell.applied for cell in panel.cells if cell.applied is not None)
    return list(found.items())


def settings_of(panel: Panel) -> list[tuple[str, str]]:
    """Entries of the spec that are plain values, and the environment's own arguments."""
    spec = panel.spec
    flat = [(str(name), _plain(value)) for name, value in spec.items() if _is_plain(value)]
    for group in ("environment", "training"):
        inner = spec.get(group)
        if isinstance(inner, Mapping):
            flat += [(str(name), _plain(value)) for name, value in inner.items()]
    return flat


def _is_plain(value: Any) -> bool:
    if isinstance(value, list):
        return bool(value) and all(not isinstance(item, list | Mapping) for item in value)
    return not isinstance(value, Mapping)


def _plain(value: Any) -> str:
    if isinstance(value, bool) or value is None:
        return {True: "true", False: "false", None: "none"}[value]
    if isinstance(value, list):
        return ", ".join(_plain(item) for item in value)
    return json.dumps(value) if isinstance(value, Mapping) else str(value)


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
        ("energy residual", _long(entry.energy_residual, _format_residual, " J")),
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


def _format_residual(value: float | None) -> str:
    return compact(value, 3, True)


def _long(
    value: Estimate | None, show: Callable[[float | None], str], unit: str = ""
) -> str | None:
    if value is None:
        return None
    if not value.bounded:
        return f"{show(value.estimate)}{unit}"
    return f"{show(value.estimate)} ({show(value.low)} to {show(value.high)}){unit}"
