"""What to conclude from false passes and false fails, in plain sentences."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from integ_gym.support.terminal import NONE, fixed, plural

from ..panel.result import Entry, Panel, Row, Verdict
from ..verdict import PASS, UNSOLVABLE
from .forests import Trust
from .matrices import CLASS_WORDS

_NAMED: Final = 5  # names in one sentence


@dataclass(frozen=True)
class Finding:
    """One plain sentence about false passes or false fails.

    Attributes
    ----------
    kind
        `fails`, `false_pass`, `false_fail`, `agreement` or `missing`.
    lead
        The sentence.
    close
        Whether seed noise alone could move a rate in it across the line.
    entries
        How many entries of the matrix it speaks of.
    """

    kind: str
    lead: str
    close: bool = False
    entries: int = 0


def findings_of(panel: Panel, trusts: Sequence[Trust]) -> tuple[Finding, ...]:
    """What to conclude: what fails to transfer, then how cells agree with the truth.

    Of the latter the surest comes first; cells that cannot be solved in time are left out.
    """
    verdicts = tuple(_failing(panel, one) for one in panel.verdicts if one.verdict == "fails")
    return (*verdicts, *_against_truth(panel, trusts))


def _failing(panel: Panel, judged: Verdict) -> Finding:
    """A declared transfer that fails."""
    home, there = panel.row(judged.row).home_success, panel.entry(judged.row, judged.cell)
    rates = f"{fixed(home.estimate) if home else NONE} at home and {_rate(there)} on {judged.cell}"
    return Finding(
        "fails",
        f"{judged.row} does not transfer to {judged.cell}: success is {rates}, of which "
        f"{fixed(judged.overfitting.estimate)} is lost by overfitting.",
    )


def _against_truth(panel: Panel, trusts: Sequence[Trust]) -> tuple[Finding, ...]:
    if panel.truth is None or not trusts:
        lead = (
            "There is no truth column here: this page shows where discretizations disagree, not "
            "which of them is right."
            if panel.truth is None
            else "Nothing was compared with the truth here, so this panel cannot tell false "
            "passes from true ones."
        )
        return (Finding("missing", lead),)
    judged = [entry for trust in trusts for entry in trust.judged]
    passes = (_false_passes(panel, trusts, row) for row in panel.ordered_rows)
    fails = (_false_fails(panel, trust) for trust in trusts)
    found = [finding for finding in (*passes, *fails) if finding]
    found.sort(key=lambda finding: (finding.close, -finding.entries))
    return (_agreement(panel, judged), *found)


def _agreement(panel: Panel, judged: Sequence[Entry]) -> Finding:
    left = [cell.name for cell in panel.columns if cell.achievability in UNSOLVABLE]
    out = f" Left out: {_and(left, 'cells')}, which cannot be solved in time." if left else ""
    wrong = [entry for entry in judged if entry.contradicted]
    if not wrong:
        return Finding(
            "agreement",
            f"Every pass and every fail agrees with the truth, in all {len(judged)} "
            f"pairs of policies and discretizations compared{_none_passes(judged)}.{out}",
        )
    counts = Counter(str(entry.reference_class) for entry in wrong)
    parts = [
        plural(counts[kind], CLASS_WORDS[kind], more)
        for kind, more in (("false_pass", "false passes"), ("false_fail", "false fails"))
        if counts[kind]
    ]
    return Finding(
        "agreement",
        f"{len(judged) - len(wrong)} of {plural(len(judged), 'answer')} agree with the "
        f"truth; {' and '.join(parts)} {'does' if len(wrong) == 1 else 'do'} not.{out}",
    )


def _none_passes(judged: Sequence[Entry]) -> str:
    passing = any(entry.reference_class == "true_pass" for entry in judged)
    return "" if passing else ", but none of them passes: this tells nothing about transfer"


def _false_passes(panel: Panel, trusts: Sequence[Trust], row: Row) -> Finding | None:
    """Where a row that fails on the reference passes."""
    wrong = [e for trust in trusts for e in trust.of("false_pass") if e.row == row.name]
    if not wrong:
        return None
    truth = panel.on_truth(row.name)
    at_home = next((entry for entry in wrong if entry.cell == row.home), None)
    others = _and([f"{e.cell} ({_rate(e)})" for e in wrong if e is not at_home], "cells")
    if at_home is None:
        text = f"{row.name} reaches {_rate(truth)} on the truth, but passes on {others}."
    else:
        given = row.kind == "given"
        who = f"{row.name} reaches" if given else f"The policies trained on {row.name} reach"
        text = (
            f"{who} {_rate(at_home)} at home but {_rate(truth)} on the truth: that win belongs "
            "to the simulator, not to the physics."
        )
        if others:
            text += f" {'It also passes' if given else 'They also pass'} on {others}."
    close = _undecided(truth) or any(_undecided(e) for e in ([at_home] if at_home else wrong))
    return Finding("false_pass", text, close, len(wrong))


def _false_fails(panel: Panel, trust: Trust) -> Finding | None:
    """What works on the reference and fails in one cell.

    A row that is shown not to transfer to the truth does not work there.
    """
    truth = panel.truth and panel.truth.name
    failing = {v.row for v in panel.verdicts if v.verdict == "fails" and v.cell == truth}
    wrong = [entry for entry in trust.of("false_fail") if entry.row not in failing]
    if not wrong:
        return None
    pairs = [f"{e.row} ({_rate(e)} against {_rate(panel.on_truth(e.row))})" for e in wrong]
    rows = _and(pairs, "rows")
    text = (
        f"{trust.cell.name} fails what passes on the truth: {rows}. Judged there, "
        f"{'policies that work' if len(wrong) > 1 else 'a policy that works'} would be "
        "thrown away."
    )
    close = any(_undecided(entry) or _undecided(panel.on_truth(entry.row)) for entry in wrong)
    return Finding("false_fail", text, close, len(wrong))


def _rate(entry: Entry | None) -> str:
    return NONE if entry is None else fixed(entry.success.estimate)


def _undecided(entry: Entry | None) -> bool:
    """Whether the interval of the rate reaches across the line between pass and fail."""
    if entry is None:
        return False
    low, high = entry.success.ends
    return low < PASS <= high


def _and(parts: Sequence[str], noun: str) -> str:
    """Names as a list in a sentence, cut where it gets too long to read."""
    named = list(parts)
    if len(parts) > _NAMED:
        named = [*parts[: _NAMED - 1], f"{len(parts) - _NAMED + 1} other {noun}"]
    if len(named) < 2:
        return "".join(named)
    return f"{', '.join(named[:-1])} and {named[-1]}"
