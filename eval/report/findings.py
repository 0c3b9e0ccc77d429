"""What to conclude from false passes and false fails, in plain sentences."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple

from integ_gym.support.terminal import NONE, fixed, plural

from ..panel.result import Entry, Panel
from ..verdict import PASS, UNSOLVABLE
from .forests import Trust

_MOST_NAMES: Final = 5  # in one sentence


class Finding(NamedTuple):
    """One plain sentence about false passes or false fails.

    Attributes:
        kind: `fails`, `false_pass`, `false_fail`, `agreement` or `missing`.
        lead: the sentence.
        close: whether seed noise alone could move a rate in it across the line.
        entries: how many entries of the matrix it speaks of.
    """

    kind: str
    lead: str
    close: bool = False
    entries: int = 0


def findings_of(panel: Panel, trusts: Sequence[Trust]) -> list[Finding]:
    """What to conclude: what fails to transfer, then how cells agree with the truth.

    Of the latter the surest comes first; cells that cannot be solved in time are left out.
    """
    fails = []
    for one in panel.verdicts:
        if one.verdict == "fails":
            home = panel.row(one.row).home_success
            text = (
                f"{panel.in_words(one.row)} does not transfer to {panel.in_words(one.cell)}: "
                f"success is {fixed(home.estimate) if home else NONE} at home and "
                f"{_rate(panel.entry(one.row, one.cell))} there, of which "
                f"{fixed(one.overfitting.estimate)} is lost by overfitting."
            )
            fails.append(Finding("fails", text))
    if panel.yardstick is None:
        text = (
            "There is no truth column here: this page shows where discretizations disagree, not "
            "which of them is right."
        )
    elif not trusts:
        text = (
            f"Nothing was compared with the {panel.yardstick_name} here, so this panel cannot tell "
            "false passes from true ones."
        )
    else:
        wrong = [*_false_passes(panel, trusts), *_false_fails(panel, trusts)]
        wrong.sort(key=lambda finding: (finding.close, -finding.entries))
        return [*fails, _agreement(panel, trusts), *wrong]
    return [*fails, Finding("missing", text)]


def _agreement(panel: Panel, trusts: Sequence[Trust]) -> Finding:
    judged = [entry for trust in trusts for entry in trust.judged]
    left = [panel.in_words(cell.name) for cell in panel.columns if cell.achievability in UNSOLVABLE]
    out = f" Left out: {_and(left, 'cells')}, which cannot be solved in time." if left else ""
    counts: Counter[str | None] = Counter(entry.reference_class for entry in judged)
    parts = [
        plural(counts[kind], words, more)
        for kind, words, more in (
            ("false_pass", "false pass", "false passes"),
            ("false_fail", "false fail", "false fails"),
        )
        if counts[kind]
    ]
    if not parts:
        nothing = "" if counts["true_pass"] else ", but none of them passes: this shows nothing "
        nothing += "about transfer" if nothing else ""
        return Finding(
            "agreement",
            f"Every pass and every fail agrees with the {panel.yardstick_name}, in all "
            f"{len(judged)} pairs of policies and discretizations compared{nothing}.{out}",
        )
    right = counts["true_pass"] + counts["true_fail"]
    of_baselines = sum(panel.row(entry.row).baseline for entry in judged)
    among = f", {of_baselines} of them of baselines," if of_baselines else ""
    return Finding(
        "agreement",
        f"{right} of {plural(len(judged), 'answer')}{among} agree with the {panel.yardstick_name}; "
        f"{' and '.join(parts)} "
        f"{'does' if len(judged) - right == 1 else 'do'} not.{out}",
    )


def _false_passes(panel: Panel, trusts: Sequence[Trust]) -> Iterator[Finding]:
    """Where rows that fail on the reference pass."""
    for row in panel.ordered_rows:
        wrong = [e for trust in trusts for e in trust.of("false_pass") if e.row == row.name]
        if not wrong:
            continue
        truth = panel.on_yardstick(row.name)
        at_home = next((entry for entry in wrong if entry.cell == row.home), None)
        away = [entry for entry in wrong if entry is not at_home]
        others = _and([f"{panel.in_words(e.cell)} ({_rate(e)})" for e in away], "cells")
        name = panel.in_words(row.name)
        if at_home is None:
            text = f"{name} reaches {_rate(truth)} {panel.at_yardstick}, but passes on {others}."
        else:
            given = row.kind == "given"
            who = f"{name} reaches" if given else f"The policies trained on {name} reach"
            text = (
                f"{who} {_rate(at_home)} at home but {_rate(truth)} {panel.at_yardstick}: that win "
                "belongs to the simulator, not to the physics."
            )
            if others:
                text += f" {'It also passes' if given else 'They also pass'} on {others}."
        close = any(_is_undecided(e) for e in (truth, *([at_home] if at_home else wrong)))
        yield Finding("false_pass", text, close, len(wrong))


def _false_fails(panel: Panel, trusts: Sequence[Trust]) -> Iterator[Finding]:
    """What works on the reference and fails in one cell.

    A row that is shown not to transfer to the truth does not work there.
    """
    truth = panel.yardstick and panel.yardstick.name
    failing = {v.row for v in panel.verdicts if v.verdict == "fails" and v.cell == truth}
    for trust in trusts:
        wrong = [entry for entry in trust.of("false_fail") if entry.row not in failing]
        if not wrong:
            continue
        on_truth = [panel.on_yardstick(entry.row) for entry in wrong]
        pairs = [
            f"{panel.in_words(entry.row)} ({_rate(entry)} against {_rate(there)})"
            for entry, there in zip(wrong, on_truth, strict=True)
        ]
        rows = _and(pairs, "rows")
        text = (
            f"{panel.in_words(trust.cell.name)} fails what passes {panel.at_yardstick}: {rows}. "
            f"Judged there, {'policies that work' if len(wrong) > 1 else 'a policy that works'} "
            "would be thrown away."
        )
        close = any(_is_undecided(entry) for entry in (*wrong, *on_truth))
        yield Finding("false_fail", text, close, len(wrong))


def _rate(entry: Entry | None) -> str:
    return NONE if entry is None else fixed(entry.success.estimate)


def _is_undecided(entry: Entry | None) -> bool:
    """Whether the interval of the rate reaches across the line between pass and fail."""
    return entry is not None and entry.success.ends[0] < PASS <= entry.success.ends[1]


def _and(parts: Sequence[str], noun: str) -> str:
    """Names as a list in a sentence, cut where it gets too long to read."""
    names = list(parts)
    if len(parts) > _MOST_NAMES:
        names = [*parts[: _MOST_NAMES - 1], f"{len(parts) - _MOST_NAMES + 1} other {noun}"]
    return " and ".join(filter(None, (", ".join(names[:-1]), *names[-1:])))
