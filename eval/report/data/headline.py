"""The panel's question answered in two sentences, for whoever has ten seconds."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from integ_gym.support import compact, fixed, plural

from ...panel.model import Entry, Panel, Row, Verdict
from ...verdict import EQUIVALENCE_MARGIN, FAIL_MARGIN, WITHOUT_VERDICT

_NAMED = 3  # cells in one sentence


def headline_of(panel: Panel) -> str:
    """The largest loss by overfitting; then what holds and what cannot be solved.

    Of a policy that was given, how it does at home, on the truth, and where it is worst. Where no
    declared transfer can be judged, the panel's own answer; without a declared family, the largest
    loss of all.
    """
    given = [row for row in panel.rows if row.kind == "given"]
    if panel.given_alone and given:
        return _given(panel, given[0])
    judged = [one for one in panel.verdicts if one.verdict not in WITHOUT_VERDICT]
    if not judged:
        return panel.answer if panel.verdicts or not panel.exploratory else _explored(panel)
    worst = max(judged, key=lambda one: one.overfitting.estimate)
    late = max(judged, key=lambda one: one.deadline.estimate)
    remark = "" if worst.verdict == "fails" else worst.verdict
    return f"{_largest(panel, worst, remark)}{_late(panel, late)} {_rest(panel, judged)}"


def _given(panel: Panel, row: Row) -> str:
    home = panel.entry(row.name, row.home) if row.home else None
    known = [(home, "at home"), (panel.on_truth(row.name), "on the truth")]
    places = [(entry, where) for entry, where in known if entry is not None]
    if places:
        told = [f"{_earned(panel, entry)} {where}" for entry, where in places]
        first = f"{row.name} {' and '.join(told)}."
    else:
        first = f"It is not known what {row.name} was trained on, and there is no truth here."
    others = [e for cell in panel.columns if (e := panel.entry(row.name, cell.name)) is not None]
    if places and panel.truth is not None and not any(e.success.estimate for e, _ in places):
        return f"{first} {_by_return(places[0][0], others)}"
    worst = min(others, key=lambda entry: _value(panel, entry))
    if places and _value(panel, worst) == min(_value(panel, entry) for entry, _ in places):
        return f"{first} It does no worse on any of {plural(len(others), 'discretization')}."
    return f"{first} Worst is {worst.cell}: there it {_earned(panel, worst)}."


def _by_return(own: Entry, others: Sequence[Entry]) -> str:
    """Of a policy that never succeeds, so that there is no success to lose: its returns."""
    told = [(x.returns.estimate, x.cell) for x in others if x.returns is not None]
    if own.returns is None or not told:
        return "Where there is no success, none can be lost."
    least, where = min(told)
    return (
        f"Where there is no success, none can be lost; its mean return is lowest on {where}: "
        f"{compact(least, 4)}, where {own.cell} gives {compact(own.returns.estimate, 4)}."
    )


def _earned(panel: Panel, entry: Entry) -> str:
    """What a policy gets, in words: successes, or its return where no truth judges success."""
    if panel.truth is None and entry.returns is not None:
        return f"earns {compact(entry.returns.estimate, 4)}"
    succeeds = round(entry.success.estimate * entry.episodes)
    return f"succeeds from {succeeds or 'none'} of {plural(entry.episodes, 'start')}"


def _value(panel: Panel, entry: Entry) -> float:
    own = entry.returns if panel.truth is None and entry.returns else entry.success
    return own.estimate


def _explored(panel: Panel) -> str:
    """Of a panel without a declared family: the largest loss, then how many there are."""
    found, lost = panel.exploratory, panel.exploratory_failures
    lose = _verb(lost, "loses", "lose")
    rest = "; ".join([f"{lost} of {plural(len(found), 'transfer')} {lose} more than {FAIL_MARGIN}",
                      *_closed(panel)])  # fmt: skip
    return f"{_largest(panel, found[0], 'exploratory')} No family was declared: {rest}."


def _largest(panel: Panel, worst: Verdict | Entry, remark: str = "") -> str:
    """The largest loss by overfitting in a sentence.

    Args:
        panel: that it is of.
        worst: where it is.
        remark: what must be known of it.
    """
    home = panel.row(worst.row).home_success
    there = panel.entry(worst.row, worst.cell)
    overfitting = worst.overfitting.estimate if worst.overfitting else 0.0
    if there is None or overfitting <= EQUIVALENCE_MARGIN:
        return (
            f"No {'' if remark else 'declared '}transfer loses more than "
            f"{fixed(max(overfitting, 0.0))} of success by overfitting; the most is lost by "
            f"{worst.row} on {worst.cell}."
        )
    at_home = f"{fixed(home.estimate)} at home and " if home else ""
    return (
        f"Policies trained on {worst.row} reach success {at_home}{fixed(there.success.estimate)} "
        f"on {worst.cell}; {fixed(overfitting)} is lost by overfitting to the "
        f"simulator{f' ({remark})' if remark else ''}."
    )


def _late(panel: Panel, late: Verdict) -> str:
    """The largest loss to the deadline, in a sentence after a space; nothing if small."""
    there = panel.entry(late.row, late.cell)
    if there is None or late.deadline.estimate < EQUIVALENCE_MARGIN:
        return ""
    return (
        f" The deadline costs {late.row} {fixed(late.deadline.estimate)} on {late.cell}: success "
        f"{fixed(there.success.estimate)} there, {fixed(there.recovered.estimate)} in twice the "
        "time."
    )


def _rest(panel: Panel, judged: Sequence[Verdict]) -> str:
    counts = Counter(str(one.verdict) for one in judged)
    holding = [f"{one.row} on {one.cell}" for one in judged if one.verdict == "transfers"]
    parts = [
        f"{counts[verdict]} {words}"
        for verdict, words in (
            ("fails", _verb(counts["fails"], "fails", "fail")),
            ("transfers", _verb(len(holding), "holds", "hold") + _listed(holding)),
            ("inconclusive", _verb(counts["inconclusive"], "is", "are") + " undecided"),
        )
        if counts[verdict]
    ]
    more = "".join(f"; {closed}" for closed in _closed(panel))
    told = " and ".join([", ".join(parts[:-1]), parts[-1]] if len(parts) > 1 else parts)
    some = " that can be judged" if len(judged) < len(panel.verdicts) else ""
    return f"Of {plural(len(judged), 'declared transfer')}{some} {told}{more}."


def _closed(panel: Panel) -> list[str]:
    """What cannot be solved in time, in a clause; none where there is nothing."""
    never, late = (
        [cell.name for cell in panel.columns if cell.achievability == status]
        for status in ("unachievable", "too_slow")
    )
    closed = [f"no control that was found solves {_named(never)}"] if never else []
    closed += [f"only twice the time solves {_named(late)}"] if late else []
    return [" and ".join(closed)] if closed else []


def _verb(count: int, one: str, more: str) -> str:
    return one if count == 1 else more


def _listed(names: Sequence[str]) -> str:
    return f" ({_named(names)})" if names else ""


def _named(names: Sequence[str]) -> str:
    more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    return ", ".join(names[:_NAMED]) + more
