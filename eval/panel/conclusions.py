"""What a panel concludes, in sentences: terminal, page and figures take them from here.

The answer's first line always has the same order: success at home, on the truth (or at the limit),
what is lost, and whether dt is the cause. Everything is read from a :class:`Panel`, which holds
numbers and codes; nothing is computed here but means.
"""

from __future__ import annotations

import json
import math
import shlex
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import chain
from typing import Final, Literal, TypeAlias

from integ_gym.envs.environment import is_integ_environment
from integ_gym.envs.settings import NATIVE
from integ_gym.support.terminal import fixed, list_some, percent, plural, true_minus

from ..contract import BoundaryCheck, Contract
from ..power import WITHOUT_VERDICT, Verdict
from ..statistics import Estimate, highest_share
from ..verdict import (
    ALPHA,
    EQUIVALENCE_MARGIN,
    FAIL_MARGIN,
    LEARNED,
    MIN_SEEDS,
    UNSOLVABLE,
    UNSOLVED,
    Achievability,
    CellFinding,
    PolicyComparison,
    adjust_for_look,
    p_text,
    share_of_look,
)
from .cells import Cell
from .result import (
    MEASURES,
    MOST_CHANGED,
    EngineAgreement,
    Entry,
    Measure,
    PairedEpisodes,
    Panel,
    Remedy,
    Row,
    Separation,
    Stage,
)

Cause: TypeAlias = Literal["cause", "not_cause", "gained", "closed", "not_learned", "undecided"]
"""Whether dt is the cause of a loss.

`gained`: the policy does better where it is held against home. `closed`: it is held against a cell
that cannot be solved in time, or of which that is not known. `not_learned`: too little success at
home to lose any.
"""

Status: TypeAlias = Cause | Literal["home_unknown", "home_decides", "contract_error", "exploratory"]
"""The same, and what else may be said of a row.

`home_unknown`: nothing states what it was trained on. `home_decides`: its home is the truth, or the
finest step that was evaluated. `contract_error`: the cell differs from home before any integration.
`exploratory`: a loss of a panel that declared no family.
"""

RETURN_MARGIN: Final = 0.1
"""Returns are practically equal within this share of the policy's lead over random at home."""

UNSKILLED: Final = ("random", "zero")
"""Baselines that know nothing of a task."""

_MOST_NAMES: Final = 3  # cells in one sentence


@dataclass(frozen=True)
class Finding:
    """What the first line speaks of, which the page shows first.

    Attributes:
        row: name of the row.
        home: name of the cell that it was trained in; None: unknown, or a mixture.
        cell: name of the cell that it is held against; None where there is nothing.
        measure: `success`, or `return` where success cannot tell.
        status: see :data:`Status`.
        at_home: success rate or mean return at home; None: unknown.
        there: the same in the cell.
        lost: the difference with its interval; None where there is none.
    """

    row: str
    home: str | None
    cell: str | None
    measure: Literal["success", "return"]
    status: Status
    at_home: float | None
    there: float | None
    lost: Estimate | None

    @property
    def digits(self) -> int:
        """Decimals of its numbers; of returns those that the larger one carries."""
        known = [abs(x) for x in (self.at_home, self.there) if x is not None]
        return 2 if self.measure == "success" else _digits(known)

    def lost_words(self, lost: Estimate, *, level: bool = False, more: str = "") -> str:
        """`lost 0.60 (0.45 to 0.73)`, or `gained …`."""
        if lost.estimate < 0.0 and fixed(-lost.estimate, self.digits) != fixed(0.0, self.digits):
            low, high = (None if end is None else -end for end in (lost.high, lost.low))
            gained = Estimate(-lost.estimate, low, high, lost.level)
            return f"gained {gained.in_words(self.digits, level=level, more=more)}"
        return f"lost {lost.in_words(self.digits, level=level, more=more)}"


def answer_lines(panel: Panel) -> tuple[str, ...]:
    """The answer, a line for each thing that is said; the first is the headline.

    Where the rule of success looks wrong, the headline begins with that; where training seeds are
    missing, a line says so before it.
    """
    if panel.given_alone:
        finding = finding_of(panel)
        lines = ["There is nothing to judge."] if finding is None else _paragraphs(panel, finding)
    else:
        lines = [*_trained(panel), limit_words(panel)]
    first, *others = filter(None, lines)
    undecided = "" if panel.stage is None else _stage_words(panel.stage)
    headline = f"{success_doubt(panel)} {first}".lstrip()
    every = (undecided, headline, *others, separation_words(panel), *_contract_lines(panel))
    return tuple(filter(None, every))


def _contract_lines(panel: Panel) -> Iterator[str]:
    """Where cells differ from home before any integration, a line for each way in which they do."""
    found: dict[str, list[str]] = {}
    for entry in panel.matrix:
        words = contract_reason(panel, entry.row, entry.cell)
        if words:
            found.setdefault(words, []).append(entry.cell)
    for words, cells in found.items():
        where = _list_cells(panel, dict.fromkeys(cells))
        yield f"No verdict on {where}: {words}"


def contract_reason(panel: Panel, row: str, cell: str) -> str:
    """How a cell differs from a row's home before any integration; empty where it does not."""
    contract = panel.broken_contract(row, cell)
    return "" if contract is None else f"contract differs: {'; '.join(contract_words(contract))}."


def separation_words(panel: Panel) -> str:
    """What each difference costs in the cell with several that loses most; empty without any.

    Of success, or of return per second where no success is shown to be lost.
    """
    losses = [own[0] for own in separations_by_measure(panel).values()]
    worst = next((one for one in losses if one.lost.ends[0] > 0.0), next(iter(losses), None))
    if worst is None:
        return ""
    parts = [
        f"{one.axis} {cost_words(worst, one.lost_alone)}"
        for one in worst.axes
        if one.lost_alone is not None
    ]
    what = "" if worst.measure == "success" else " of return per second"
    whole = f"{cost_words(worst, worst.lost)}{what}"
    where = f"In {panel.in_words(worst.cell)}, {panel.in_words(worst.row)} loses {whole}"
    return f"{where}; each difference alone: {', '.join(parts)}." if parts else f"{where}."


def separations_by_measure(panel: Panel) -> dict[Measure, list[Separation]]:
    """What differences cost, by measure, what loses most first."""
    ordered = sorted(panel.separations, key=lambda one: -one.lost.estimate)
    found = {name: [one for one in ordered if one.measure == name] for name in MEASURES}
    return {name: own for name, own in found.items() if own}


def cost_words(separation: Separation, lost: Estimate) -> str:
    """A loss with its interval; of returns with the digits that the largest one carries."""
    parts = (x for axis in separation.axes for x in (axis.lost_alone, axis.lost_without))
    sizes = [abs(one.estimate) for one in (separation.lost, *parts) if one is not None]
    return lost.in_words(2 if separation.measure == "success" else _digits(sizes))


def _digits(sizes: Sequence[float]) -> int:
    """Decimals with which the largest size has four digits."""
    size = max(sizes, default=0.0)
    digits = 3 - math.floor(math.log10(size)) if size > 0.0 and math.isfinite(size) else 2
    return min(max(digits, 0), 6)


def warning_lines(panel: Panel) -> tuple[str, ...]:
    """What a reader must know before trusting a panel: doubts, and that it was looked at before."""
    looks = _look_warnings(panel) if panel.stage is None else ()
    return (*panel.doubts, *looks)


def _stage_words(stage: Stage) -> str:
    return (
        f"Not decided yet: {stage.seeds} of {stage.of} training seeds are here; the rest is being "
        "trained and judged, and this page is written again as they arrive."
    )


def _look_warnings(panel: Panel) -> Iterator[str]:
    """That what is concluded was seen before, with fewer seeds or starts."""
    if not panel.looks:
        return
    planned, now = panel.spec.get("looks") or (), panel.looks[-1]
    if planned and now.seeds not in planned:
        yield (
            f"This look at {plural(now.seeds, 'seed')} was not planned: the specification's "
            f"`looks` are at {', '.join(map(str, planned))} seeds, which have the whole level. So "
            "it gives no verdict."
        )
    if len(panel.looks) < 2:
        return
    before, number = panel.looks[-2], len(panel.looks)
    if any(row.kind == "given" for row in panel.rows):
        yield (
            f"These results were seen before, the last time on {plural(before.episodes, 'start')}: "
            f"this is look {number}. Looks share the level of {ALPHA}, so p-values are multiplied "
            f'by {1.0 / share_of_look(number):.0f} here. "Practically equal" rests on 95 % '
            "intervals, which are not adjusted for looks, and is no verdict."
        )
    if not (panel.verdicts or panel.policy_comparisons):
        return
    seen = f"{plural(before.seeds, 'seed')} of {plural(before.episodes, 'start')}"
    if before.adopted:
        seen += " in the run whose policies were taken"
    levels = {"fails": now.level_exceeds, "transfers": now.level_equivalent}
    shares = (
        f"{level:.2g} to `{verdict}`" if level else f"nothing to `{verdict}`"
        for verdict, level in levels.items()
    )
    yield (
        f"Verdicts were seen before, the last on {seen}; this is look {number}. Looks share the "
        f"level of {ALPHA}: this one gives {' and '.join(shares)}, and its p-values are multiplied "
        "accordingly."
    )


def success_doubt(panel: Panel) -> str:
    """Why the rule of success looks wrong, in a sentence; empty where nothing speaks for it.

    It looks wrong where a baseline that knows nothing of the task succeeds more than a policy and
    returns less, on the same starts.
    """
    found = []
    for entry in panel.matrix:
        if panel.row(entry.row).baseline or entry.returns is None:
            continue
        for base in (panel.entry(name, entry.cell) for name in UNSKILLED):
            if base is None or base.returns is None:
                continue
            more = base.success.estimate - entry.success.estimate
            if more > FAIL_MARGIN and base.returns.estimate < entry.returns.ends[0]:
                found.append((more, entry, base))
    if not found:
        return ""
    _, entry, base = max(found, key=lambda one: one[0])
    theirs, own = (
        f"{one.row} succeeds in {percent(one.success.estimate)} of episodes with a mean return of "
        f"{fixed(one.value('return'), 1)}"
        for one in (base, entry)
    )
    return (
        f"The rule of success looks wrong: on {panel.in_words(entry.cell)}, {theirs}, and {own}. "
        "Compare returns, or say which return is a success (--success-return R, where the task "
        "takes it)."
    )


def finding_of(panel: Panel) -> Finding | None:
    """What the first line speaks of; None where it is of no row."""
    given = [row for row in panel.rows if row.kind == "given"]
    if panel.given_alone:
        return _finding_of_given(panel, given[0]) if given else None
    if panel.check:
        return _finding_of_check(panel, panel.rows[0])
    if judged := _declared_verdicts(panel):
        worst = _worst(panel, judged)
        row, cell, lost = worst.row, worst.cell, worst.total
        codes: dict[str, Status] = {"fails": "cause", "transfers": "not_cause"}
        status = codes.get(worst.verdict, "undecided")
    else:
        entry = None if panel.verdicts else next(iter(panel.exploratory), None)
        if entry is None or entry.home_drop is None:
            return None
        row, cell, lost, status = entry.row, entry.cell, entry.home_drop, "exploratory"
    own, there = panel.row(row), _value(panel.entry(row, cell), "success")
    at_home = None if own.home_success is None else own.home_success.estimate
    return Finding(row, own.home, cell, "success", status, at_home, there, lost)


# A policy that was given, and a check.


def _finding_of_check(panel: Panel, row: Row) -> Finding | None:
    cell = panel.yardstick or _finest(panel, row)
    if cell is None:
        return None
    at_home, there = (_value(panel.entry(row.name, x), "success") for x in (row.name, cell.name))
    entry = panel.entry(row.name, cell.name)
    lost = None if entry is None else entry.home_drop
    status: Status = "contract_error"
    if lost is not None:
        low, high = lost.ends
        learned, can = row.learned is not False, cell.achievability
        shown = low > 0.0 or high < 0.0
        status = cause_of(lost, shown=shown, learned=learned, achievability=can)
    return Finding(row.name, row.home, cell.name, "success", status, at_home, there, lost)


def _finding_of_given(panel: Panel, row: Row) -> Finding:
    home = row.home if row.home and panel.entry(row.name, row.home) else None
    known = bool(row.shares) and all(panel.entry(row.name, cell) for cell in row.shares)
    cell = panel.yardstick or (_finest(panel, row) if known else None)
    measure: Literal["success", "return"] = "success" if _succeeds(panel, row.name) else "return"
    at_home = _mean_over(panel, row.name, row.shares, measure) if known else None
    there = None if cell is None else _value(panel.entry(row.name, cell.name), measure)
    found = None if cell is None or not known else _find_paired(panel, row.name, cell.name)
    lost = None if found is None else found.success if measure == "success" else found.returns
    if not known:
        status: Status = "home_unknown"
    elif cell is not None and panel.broken_contract(row.name, cell.name) is not None:
        status = "contract_error"
    elif cell is None or cell.name == home or found is None or lost is None:
        status = "home_decides"
    else:
        p = found.p_success if measure == "success" else found.p_return
        share = share_of_look(max(1, len(panel.looks)))
        known_p = adjust_for_look(1.0 if p is None else p, share)
        can = cell.achievability
        if measure == "return" and can == "undecided":
            can = None  # returns tell without a success
        margin = _margin(panel, row, measure)
        status = cause_of(lost, shown=known_p < ALPHA, margin=margin, achievability=can)
    name = None if cell is None else cell.name
    return Finding(row.name, home, name, measure, status, at_home, there, lost)


def cause_of(
    lost: Estimate,
    *,
    shown: bool,
    margin: float = EQUIVALENCE_MARGIN,
    learned: bool = True,
    achievability: Achievability | None = None,
) -> Cause:
    """Whether dt is the cause of a loss.

    Args:
        lost: the loss with its interval.
        shown: whether a test or the interval shows that it is not zero.
        margin: losses within this are practically equal.
        learned: whether the task was learned at home; a policy that was given is taken as it is.
        achievability: of the cell in which it is lost; None where it was not asked, or does not
            matter.
    """
    if not learned:
        return "not_learned"
    if lost.is_within(margin):
        return "not_cause"
    if shown and lost.estimate < 0.0:
        return "gained"
    if achievability not in (None, "achievable"):
        return "closed"
    return "cause" if shown else "undecided"


def _succeeds(panel: Panel, row: str) -> bool:
    """Whether success tells how a policy does: there is a truth, and it succeeds somewhere."""
    entries = [panel.entry(row, cell.name) for cell in panel.columns]
    return panel.truth is not None and any(e and e.success.estimate > 0.0 for e in entries)


def _finest(panel: Panel, row: Row) -> Cell | None:
    """The finest step of a row's own integrator, or of any where its own is at no finer one."""
    every = [cell for cell in panel.columns if panel.entry(row.name, cell.name)]
    kept = [cell for cell in every if panel.broken_contract(row.name, cell.name) is None]
    columns = kept if any(cell.name not in row.shares for cell in kept) else every
    own = [cell for cell in columns if cell.integrator == row.integrator]
    finest = min(own or columns, key=lambda cell: cell.dt, default=None)
    if finest is not None and finest.name == row.home:
        finer = [cell for cell in columns if cell.dt < finest.dt]
        return min(finer, key=lambda cell: cell.dt, default=finest)
    return finest


def _mean_over(panel: Panel, row: str, shares: Mapping[str, float], measure: str) -> float | None:
    """What a row reaches over cells by their shares; None where one of them is not known."""
    values = [_value(panel.entry(row, cell), measure) for cell in shares]
    parts = [x * share for x, share in zip(values, shares.values(), strict=True) if x is not None]
    return sum(parts) if len(parts) == len(values) else None


def _value(entry: Entry | None, measure: str) -> float | None:
    return None if entry is None else entry.value(measure)


def _find_paired(panel: Panel, row: str, cell: str) -> PairedEpisodes | None:
    return next((one for one in panel.paired if one.row == row and one.cell == cell), None)


def _lead(panel: Panel, row: Row) -> float:
    """By how much a row's mean return at home exceeds random's; 0 where that is not known."""
    own, random = (_mean_over(panel, name, row.shares, "return") for name in (row.name, "random"))
    return 0.0 if own is None or random is None else own - random


def _margin(panel: Panel, row: Row, measure: str) -> float:
    """Differences within this are practically equal."""
    if measure == "success":
        return EQUIVALENCE_MARGIN
    return RETURN_MARGIN * max(0.0, _lead(panel, row))


def _paragraphs(panel: Panel, finding: Finding) -> list[str]:
    row = panel.row(finding.row)
    split = finding.status == "cause" and finding.measure == "success"
    return [
        _first(panel, finding, row),
        _about_home(panel, finding, row),
        limit_words(panel),
        _split(panel.entry(row.name, finding.cell)) if split and finding.cell else "",
        *_comparison_lines(panel, finding, row),
        _returns(panel, finding, row),
        *_closed_cell_lines(panel),
    ]


def _first(panel: Panel, finding: Finding, row: Row) -> str:
    """At home x, on the truth y, lost z: dt is, or is not, the cause."""
    what, where, differs = _MEASURES[finding.measure], _where(panel, finding.cell), "dt"
    if _is_engine_alone(panel, finding):
        where, differs = f"in {finding.cell}", "the engine"
    if finding.status == "home_unknown":
        entry = panel.entry(row.name, finding.cell) if finding.cell else None
        own = entry and (entry.success if finding.measure == "success" else entry.returns)
        known = f"{what} {where} {own.in_words(finding.digits)}; home" if own else "Home"
        return f"{known} unknown, so what is lost is unknown, and so is whether dt is the cause."
    at_home = f"{what} at home {fixed(finding.at_home, finding.digits)}"
    there = f"{where} {fixed(finding.there, finding.digits)}"
    if finding.status == "contract_error":
        return f"{at_home}, {there}: the contract differs, so nothing is said about dt."
    if finding.status == "home_decides" or finding.lost is None:
        more = _exception(panel, finding, row)
        if panel.truth is not None and finding.home == panel.truth.name:
            return f"{at_home}, and home is the truth: dt is not the cause{more}."
        finest = "home is the finest step here, so whether dt is the cause is unknown"
        return f"{at_home}, and {finest}{more}."
    sample = plural(row.seeds, "seed") if panel.check else plural(_starts(panel, row), "start")
    end = {
        "cause": f"{differs} is the cause.",
        "not_cause": f"practically equal ({_margin_words(finding)}), {differs} is not the cause",
        "gained": f"nothing is lost, and {differs} makes it look worse at home",
        "closed": _end_closed(panel, finding),
        "not_learned": "too little was learned at home to show a loss.",
    }.get(finding.status, f"{sample} do not show whether {differs} is the cause")
    if panel.check and finding.status == "undecided" and is_small(finding.lost):
        end = f"dt is not a cause of losing more than {fixed(finding.lost.ends[1])}"
    if not end.endswith("."):
        end += f"{_exception(panel, finding, row)}."
    return f"{at_home}, {there}, {_lost(panel, finding, row)}: {end}"


def _is_engine_alone(panel: Panel, finding: Finding) -> bool:
    """Whether home is held against another engine at the same step."""
    if finding.home is None or finding.cell is None:
        return False
    home, cell = panel.cell(finding.home), panel.cell(finding.cell)
    return home.dt == cell.dt and home.engine != cell.engine


def is_small(lost: Estimate) -> bool:
    """Whether the interval of a loss that is not shown leaves no large one open."""
    return lost.ends[1] < FAIL_MARGIN


def _exception(panel: Panel, finding: Finding, row: Row) -> str:
    """Where most is lost on another discretization, as the end of a sentence; mostly empty.

    Where no such loss is large, settings of the solver are looked at.
    """
    best = finding.at_home if finding.measure == "success" else _lead(panel, row)
    least = max(0.5 * (best or 0.0), FAIL_MARGIN if finding.measure == "success" else 0.0)
    columns = {cell.name for cell in panel.columns if cell.achievability not in UNSOLVABLE}
    varied = [cell for cell in panel.cells if cell.kind == "varied"]
    solvers = {cell.name for cell in varied if cell.environment.keys() == {"solver"}}
    found = []
    for one in panel.paired:
        own, p = one.difference(finding.measure) or (Estimate(0.0), 1.0)
        if one.row == row.name and p < ALPHA:
            found.append((own.estimate, one.cell))
    for names in (columns - {finding.cell}, solvers):
        lost, cell = max((one for one in found if one[1] in names), default=(0.0, ""))
        if lost > least:
            return f"; but on {panel.in_words(cell)} it loses {fixed(lost, finding.digits)}"
    return ""


def _end_closed(panel: Panel, finding: Finding) -> str:
    """Why a loss in a closed cell says nothing about dt."""
    if finding.cell is None:
        return ""
    place = f"the finest step ({finding.cell})"
    if panel.yardstick is not None:
        place = f"the {panel.yardstick_name}"
    solved = f"whether {place} can be solved in time is not known"
    if panel.cell(finding.cell).achievability in UNSOLVABLE:
        solved = f"{place} cannot be solved in time"
    return f"{solved}, so the loss says nothing about dt."


_MEASURES: Final = {"success": "Success", "return": "Mean return"}


def _where(panel: Panel, cell: str | None) -> str:
    if panel.limit is not None and cell == panel.limit.name:
        return f"at {panel.in_words(cell)}"
    if cell is None or panel.yardstick is None:
        return f"at the finest step ({cell})"
    return f"on {panel.in_words(cell)}"


def _lost(panel: Panel, finding: Finding, row: Row) -> str:
    """What is lost, with its interval, and of returns as a share of the lead over random."""
    assert finding.lost is not None
    share = ""
    if finding.measure == "return" and (lead := _lead(panel, row)) > 0.0:
        share = f"{percent(abs(finding.lost.estimate) / lead)} of its lead over random"
    return finding.lost_words(finding.lost, level=True, more=share)


def _margin_words(finding: Finding) -> str:
    if finding.measure == "success":
        return f"within ±{EQUIVALENCE_MARGIN}"
    return f"within {percent(RETURN_MARGIN)} of its lead over random"


def _starts(panel: Panel, row: Row) -> int:
    return next((entry.episodes for entry in panel.matrix if entry.row == row.name), 0)


def _about_home(panel: Panel, finding: Finding, row: Row) -> str:
    """What the home is, and what the numbers are about."""
    starts = plural(_starts(panel, row), "start")
    scope = f"One policy from the same {starts} everywhere; another training seed may differ."
    if finding.status == "home_unknown":
        return f"{_range(panel, finding)}{scope}"
    home = panel.in_words(finding.home or "") or "a mixture of " + _list_cells(panel, row.shares)
    remark = ""
    if panel.truth is not None and finding.measure == "return":
        remark = " It never succeeds, so returns are compared."
    elif panel.yardstick is None and finding.status != "home_decides":
        remark = " This task has no truth, so the finest step stands in for it."
    return f"Home is {home}.{remark} {scope}"


def limit_words(panel: Panel) -> str:
    """How the row that converges least comes to its limit, or why that is not called one.

    Of rows but baselines, at any of their control periods; empty without a limit.
    """
    own = [one for one in panel.limits if not panel.row(one.row).baseline]
    if not own:
        return ""
    found = min(own, key=lambda one: (one.converges, -one.not_converged / one.episodes))
    cells = [panel.cell(name) for name in found.steps]
    steps = ", ".join(f"{cell.dt:g}" for cell in cells[:-1]) + f" and {cells[-1].dt:g} s"
    share = f"{found.not_converged} of {plural(found.episodes, 'episode')}"
    fail = "does not converge" if found.episodes == 1 else "do not converge"
    scheme = f"{cells[-1].scheme} at {steps}"
    if not panel.given_alone:
        share += f" of {panel.in_words(found.row)}"
    if found.converges:
        most = highest_share(found.not_converged, found.episodes)
        more = f" (of all starts up to {percent(most)} may not)" if most > MOST_CHANGED else ""
        return f"The limit is extrapolated from {scheme}; {share} {fail}{more}."
    why = f"more than {percent(MOST_CHANGED)}"
    if found.grows:
        why = "and more change as the step shrinks"
    return f"No limit: from {scheme}, {share} {fail}, {why}."


def _range(panel: Panel, finding: Finding) -> str:
    """How a policy of unknown home does from the worst discretization to the best."""
    found = [(panel.entry(finding.row, cell.name), cell.name) for cell in panel.columns]
    values = [(_value(entry, finding.measure), panel.in_words(cell)) for entry, cell in found]
    known = [(value, cell) for value, cell in values if value is not None]
    if not known:
        return ""
    what, (least, worst), (most, best) = _MEASURES[finding.measure], min(known), max(known)
    low, high = (fixed(value, finding.digits) for value in (least, most))
    if least == most:
        return f"{what} is {low} on each of {len(known)} discretizations. "
    return f"{what} is from {low} ({worst}) to {high} ({best}). "


def _split(loss: Entry | Verdict | None) -> str:
    """Of what a loss of success is made."""
    if loss is None or not (loss.overfitting and loss.deadline and loss.difficulty):
        return ""
    return (
        f"Of that loss, {loss.overfitting} is overfitting to home, "
        f"{fixed(loss.deadline.estimate)} comes back in twice the time, and "
        f"{fixed(loss.difficulty.estimate)} is lost by other policies too."
    )


def _comparison_lines(panel: Panel, finding: Finding, row: Row) -> Iterator[str]:
    """Every other discretization, then every variation, beside home or the truth."""
    for noun, found in _comparisons(panel, finding, row).items():
        if found:
            yield _tally(panel, finding, row, noun, found)


def _comparisons(panel: Panel, finding: Finding, row: Row) -> dict[str, list[PairedEpisodes]]:
    """Other discretizations than the finding's, and variations, each beside home or the truth."""
    columns = {cell.name for cell in panel.columns if cell.achievability not in UNSOLVABLE}
    own = [one for one in panel.paired if one.row == row.name and one.difference(finding.measure)]
    return {
        "other discretization": [x for x in own if x.cell in columns and x.cell != finding.cell],
        "variation": [x for x in own if panel.cell(x.cell).kind == "varied"],
    }


def _judge(
    panel: Panel, finding: Finding, row: Row, one: PairedEpisodes
) -> tuple[Cause, Estimate, bool]:
    """What a comparison says, of what loss, and whether more starts may show that it is large."""
    margin = _margin(panel, row, finding.measure)
    lost, p = one.difference(finding.measure) or (Estimate(0.0), 1.0)
    status = cause_of(lost, shown=p < ALPHA, margin=margin)
    return status, lost, status == "undecided" and abs(lost.estimate) > margin


def _tally(
    panel: Panel, finding: Finding, row: Row, noun: str, found: Sequence[PairedEpisodes]
) -> str:
    judged = [(*_judge(panel, finding, row, one), one.cell) for one in found]
    counts = Counter[str](status for status, *_ in judged)
    kinds = {"cause": "lower", "gained": "higher", "undecided": "undecided"}
    kinds["not_cause"] = f"practically equal ({_margin_words(finding)})"
    parts = [f"{counts[status]} {words}" for status, words in kinds.items() if counts[status]]
    against = "home" if found[0].against == "home" else f"the {found[0].against}"
    text = f"{plural(len(found), noun)} against {against}: {', '.join(parts)}."
    changed = [(lost, cell) for status, lost, _, cell in judged if status in ("cause", "gained")]
    seeming = [(lost, cell) for _, lost, is_open, cell in judged if is_open]
    for title, named in (("Largest", changed), ("Undecided, and not small", seeming)):
        words = [
            (abs(lost.estimate), f"{panel.in_words(cell)} {finding.lost_words(lost)}")
            for lost, cell in named
        ]
        if words:
            shown = [one for _, one in sorted(words, reverse=True)[:_MOST_NAMES]]
            text += f" {title}: {'; '.join(shown)}."
    return text


def _returns(panel: Panel, finding: Finding, row: Row) -> str:
    """Returns beside success."""
    if finding.measure == "return" or finding.cell is None:
        return ""
    at_home = _mean_over(panel, row.name, row.shares, "return") if row.shares else None
    there = _value(panel.entry(row.name, finding.cell), "return")
    found = _find_paired(panel, row.name, finding.cell)
    lost = None if found is None else found.returns
    own = replace(finding, measure="return", at_home=at_home, there=there, lost=lost)
    if there is None:
        return ""
    where = f"{_where(panel, finding.cell)} {fixed(there, own.digits)}"
    if lost is None or at_home is None:
        return f"Mean return {where}."
    equal = lost.is_within(_margin(panel, row, "return"))
    end = f": practically equal ({_margin_words(own)})" if equal else ""
    home = fixed(at_home, own.digits)
    return f"Mean return at home {home}, {where}, {_lost(panel, own, row)}{end}."


# Policies that a panel trained.


def _declared_verdicts(panel: Panel) -> list[Verdict]:
    return [one for one in panel.verdicts if one.verdict not in WITHOUT_VERDICT]


def _worst(panel: Panel, judged: Sequence[Verdict]) -> Verdict:
    """The transfer that loses most by overfitting.

    Where all hold, the one that loses most otherwise; where nothing is lost, one to the truth.
    """
    for verdict in ("fails", "inconclusive"):
        if own := [one for one in judged if one.verdict == verdict]:
            return max(own, key=lambda one: one.overfitting.estimate)
    late = max(judged, key=lambda one: one.total.estimate)
    if late.total.estimate >= EQUIVALENCE_MARGIN:
        return late
    truth = [one for one in judged if panel.yardstick and one.cell == panel.yardstick.name]
    return max(truth or judged, key=lambda one: one.total.estimate)


def _trained(panel: Panel) -> tuple[str, ...]:
    judged, finding = _declared_verdicts(panel), finding_of(panel)
    if panel.check and finding is not None:
        row = panel.row(finding.row)
        split = finding.status == "cause"
        return (
            _first(panel, finding, row),
            f"Home is {panel.in_words(row.name)}; {plural(row.seeds, 'training seed')} of "
            f"{plural(panel.spec['episodes'], 'start')} each.",
            _split(panel.entry(row.name, finding.cell)) if split and finding.cell else "",
        )
    if judged and finding is not None:
        worst = _worst(panel, judged)
        return (
            f"{_trained_first(panel, finding)}: {_verdict_words(worst)}",
            _split(worst),
            _family(panel, judged),
            *_closed_cell_lines(panel),
        )
    if panel.verdicts:
        return _unjudged_lines(panel)
    if agreed := _agreement(panel.engine_agreement):
        return agreed, *_closed_cell_lines(panel)
    trained = [row for row in panel.rows if row.kind == "trained"]
    if not any(row.learned is not False for row in trained):
        return (_say_unlearned(panel, "no policies have learned", trained),)
    if finding is None:
        names = _list_cells(panel, [row.name for row in trained])
        return (
            f"Policies trained on {names} were judged nowhere but at home.",
            *_closed_cell_lines(panel),
        )
    return (*_exploratory(panel, finding), *_closed_cell_lines(panel))


def _trained_first(panel: Panel, finding: Finding) -> str:
    assert finding.lost is not None
    return (
        f"Success at home {fixed(finding.at_home)}, {_where(panel, finding.cell)} "
        f"{fixed(finding.there)}, {finding.lost_words(finding.lost, level=True)}, trained on "
        f"{panel.in_words(finding.row)}"
    )


def _verdict_words(judged: Verdict) -> str:
    if judged.verdict == "fails":
        return "dt is the cause."
    if judged.verdict == "inconclusive":
        return "it is not decided whether dt is the cause."
    if judged.total.estimate < EQUIVALENCE_MARGIN:
        return f"practically equal (within ±{EQUIVALENCE_MARGIN}), dt is not the cause."
    late = judged.deadline.estimate >= judged.difficulty.estimate
    other = "the time limit" if late else "the harder task"
    return f"{other} is the cause, overfitting to dt is not."


def _family(panel: Panel, judged: Sequence[Verdict]) -> str:
    parts = []
    for verdict, one, more in (
        ("fails", "fails", "fail"),
        ("transfers", "holds", "hold"),
        ("inconclusive", "is undecided", "are undecided"),
    ):
        own = [x for x in judged if x.verdict == verdict]
        names = list_some(
            [f"{panel.in_words(x.row)} on {panel.in_words(x.cell)}" for x in own], _MOST_NAMES
        )
        if own:
            parts.append(f"{len(own)} {one if len(own) == 1 else more} ({names})")
    some = " that can be judged" if len(judged) < len(panel.verdicts) else ""
    return f"Of {plural(len(judged), 'declared transfer')}{some}, {', '.join(parts)}."


def _exploratory(panel: Panel, finding: Finding) -> tuple[str, ...]:
    """The largest loss by overfitting of a panel without a declared family."""
    found, worst = panel.exploratory, panel.exploratory[0]
    losses = [entry.overfitting.estimate for entry in found if entry.overfitting]
    looks = "looks" if losses[0] > FAIL_MARGIN else "does not look"
    small = sum(loss <= EQUIVALENCE_MARGIN for loss in losses)
    large = sum(loss > FAIL_MARGIN for loss in losses)
    return (
        f"{_trained_first(panel, finding)}: dt {looks} like the cause (exploratory: no family was "
        "declared).",
        _split(worst),
        f"Of {plural(len(found), 'transfer')} to cells that can be solved in time, {large} "
        f"{'loses' if large == 1 else 'lose'} more than {FAIL_MARGIN} of success by overfitting "
        f"and {small} at most {EQUIVALENCE_MARGIN}.",
    )


def _unjudged_lines(panel: Panel) -> tuple[str, ...]:
    """Where no declared transfer can be judged."""
    if all(one.verdict == "contract_error" for one in panel.verdicts):
        return ("Not answered: every declared cell differs from home before any integration.",)
    if any(one.verdict != "not_learned" for one in panel.verdicts):
        return (
            "Not answered: no declared transfer can be judged, because no policy learned or no "
            "cell is known to be solvable in time.",
            *_closed_cell_lines(panel),
        )
    rows = [panel.row(name) for name in dict.fromkeys(one.row for one in panel.verdicts)]
    return (_say_unlearned(panel, "no policies of the declared transfers have learned", rows),)


def _say_unlearned(panel: Panel, who: str, rows: Iterable[Row]) -> str:
    home = {row.name: row.home_success.estimate for row in rows if row.home_success}
    nearest = ""
    if home:
        best = max(home, key=lambda row: home[row])
        named = f"those trained on {panel.in_words(best)}"
        nearest = f"; {named} come nearest, with {fixed(home[best])}"
    return (
        f"Not answered: {who}, which takes a success of {LEARNED} at home{nearest}. Train longer "
        "(`total_steps` in [training]), or set an easier task."
    )


def _agreement(found: Sequence[EngineAgreement]) -> str | None:
    """Whether cells of other engines end as their native twins; None without such cells."""
    paired = [
        (one, one.differing, one.largest)
        for one in found
        if one.differing is not None and one.largest is not None
    ]
    if not paired:
        return None
    same = sum(differing == 0 for _, differing, _ in paired)
    total = sum(one.episodes for one, _, _ in paired)
    if same == len(paired):
        return (
            f"Yes: on each of {len(paired)} cells of other engines all episodes, {total} in all, "
            "end as on the native engine with the same map, step and starts."
        )
    worst, _, largest = max(paired, key=lambda one: (one[2], one[1]))
    return (
        f"On {same} of {len(paired)} cells of other engines every episode ends as on the "
        f"native engine with the same map, step and starts; of all {total} episodes "
        f"{sum(differing for _, differing, _ in paired)} end otherwise, and no row's success "
        f"differs by more than {largest:.2f} ({worst.cell})."
    )


# Of both.


def _closed_cell_lines(panel: Panel) -> list[str]:
    """Cells in which failing says nothing of a policy, in one line."""
    parts = []
    for status, words in (
        ("unachievable", "no control that was found solves {}"),
        ("too_slow", "only twice the time solves {}"),
        ("undecided", "no policy succeeds in {}, and no search rules out that one could"),
    ):
        names = [cell.name for cell in panel.columns if cell.achievability == status]
        if names:
            parts.append(words.format(_list_cells(panel, names)))
    return [f"No conclusion is drawn from some cells: {'; '.join(parts)}."] if parts else []


def _list_cells(panel: Panel, names: Iterable[str]) -> str:
    return list_some([panel.in_words(name) for name in names], _MOST_NAMES)


# Reasons, from the codes and numbers that are stored.


def solvable_reason(panel: Panel, cell: Cell) -> str:
    """Why a cell can or cannot be solved, in a sentence; empty where that was not asked."""
    best, search = cell.best, cell.search
    if cell.achievability is None:
        return ""
    if search is not None:
        return (
            f"A search over controls reaches the goal's energy of {search.required:.3g} J from "
            f"{percent(search.reached)} of the starts within {search.horizon:g} s (at most "
            f"{max(search.highest):.3g} J)."
        )
    if best is None:
        return "Success within two horizons: not tried; no search rules the goal out."
    if best.row is None:
        who = "the hand-made controller"
    elif panel.row(best.row).kind != "trained":
        who = best.row
    elif panel.row(best.row).home == cell.name:
        who = "policies trained there"
    else:
        who = f"policies trained on {panel.in_words(best.row)}"
    if cell.achievability == "undecided":
        most = f"at most {percent(best.recovered)}, by {who}"
        return f"Success within two horizons: {most}; no search rules the goal out."
    soon = cell.achievability == "achievable"
    rate = percent(best.success if soon else best.recovered)
    time = "within the horizon" if soon else "within two horizons alone"
    return f"{who[0].upper()}{who[1:]}: success from {rate} of the starts {time}."


def contract_words(
    contract: Contract, first: str = "at home", second: str = "here"
) -> tuple[str, ...]:
    """Where two environments differ before any integration, a part of a sentence for each boundary.

    Of accelerations, constraint forces and a step, which follow from each other, only the first.

    Args:
        contract: the comparison.
        first: where the first is, in words.
        second: where the second is.
    """
    follow = [check for check in contract.broken if check.boundary in _FOLLOW]
    said = [check for check in contract.broken if check not in follow[1:]]
    return tuple(true_minus(_boundary_words(one, first, second)) for one in said)


_FOLLOW: Final = ("acceleration", "constraint", "step")
"""Boundaries of which each carries the differences of the one before."""

_QUANTITIES: Final = {"constraint": "constraint force", "step": "change of velocity in a step"}
"""Of boundaries that are not called as what is compared there."""


def _boundary_words(check: BoundaryCheck, first: str, second: str) -> str:
    quantity = _QUANTITIES.get(check.boundary, check.boundary)
    if not check.differing:
        sizes = f"{check.sizes[0]} components {first} and {check.sizes[1]} {second}"
        return f"{quantity} has {sizes}"
    shown = [
        f"{one.component}{'' if one.there == one.component else f' (there {one.there})'} "
        f"{_exact(one.first)} {first} and {_exact(one.second)} {second}"
        for one in check.differing[:_MOST_NAMES]
    ]
    more = len(check.differing) - len(shown)
    return f"{quantity} of {'; '.join(shown)}{f', and {more} more' if more else ''}"


def _exact(value: float | None) -> str:
    """With the digits that tell close numbers apart."""
    return "not finite" if value is None else f"{value:.6g}"


def verdict_reason(panel: Panel, judged: Verdict) -> str:
    """Why a verdict is what it is, in a sentence with numbers."""
    success = panel.row(judged.row).home_success
    home = fixed(success.estimate if success else None)
    if judged.verdict == "contract_error":
        reason = contract_reason(panel, judged.row, judged.cell)
        return f"{reason[0].upper()}{reason[1:]}"
    if judged.verdict == "not_learned":
        return f"Home success {home} is below {LEARNED}, so there is nothing to transfer."
    if judged.verdict in WITHOUT_VERDICT:
        return solvable_reason(panel, panel.cell(judged.cell))
    if panel.stage is not None:
        return _stage_words(panel.stage)
    entry = panel.entry(judged.row, judged.cell)
    there = fixed(entry.success.estimate if entry else None)
    later = fixed(entry.recovered.estimate if entry else None)
    seeds = f"{judged.seeds} seeds"
    if judged.natives is not None:
        seeds += f" and {judged.natives} native ones"
    change = (
        f"success {home} at home and {there} there, {later} within two horizons; overfitting "
        f"{judged.overfitting.in_words(level=True)}, deadline {fixed(judged.deadline.estimate)}, "
        f"difficulty {fixed(judged.difficulty.estimate)}"
    )
    exceeds, equivalent = (
        f"adjusted {p_text(1.0 if p is None else p)}"
        for p in (judged.p_exceeds_adjusted, judged.p_equivalent_adjusted)
    )
    if judged.few:
        return f"Only {seeds}, at least {MIN_SEEDS} needed: {change}."
    if judged.verdict == "fails":
        return f"Overfitting is above {FAIL_MARGIN} ({exceeds}, {seeds}): {change}."
    if judged.verdict == "transfers":
        return f"Overfitting is within ±{EQUIVALENCE_MARGIN} ({equivalent}, {seeds}): {change}."
    if judged.seeds < judged.seeds_for_transfers:
        equivalent = f"at least {judged.seeds_for_transfers} seeds are needed"
    return (
        f"Overfitting is shown neither to be above {FAIL_MARGIN} ({exceeds}) nor to be "
        f"within ±{EQUIVALENCE_MARGIN} ({equivalent}) with {seeds}: {change}."
    )


def comparison_reason(panel: Panel, compared: PolicyComparison) -> str:
    """Why a comparison of two rows ends as it does, in a sentence with numbers."""
    counts = Counter(cell.status for cell in compared.cells)
    informative = sum(cell.informative for cell in compared.cells)
    if not informative:
        return (
            f"No cell is informative: {counts['unsolved']} unsolved (both below "
            f"{UNSOLVED}), {counts['too_few_seeds']} with fewer than {MIN_SEEDS} seeds."
        )
    if counts["reversal"]:
        worst = min(
            (cell for cell in compared.cells if cell.status == "reversal"),
            key=lambda cell: cell.p_reversal_adjusted or 0.0,
        )
        return (
            f"The sign reverses in {counts['reversal']} of {informative} informative cells, most "
            f"clearly on {_difference_in(panel, worst, worst.p_reversal_adjusted)}."
        )
    deciding = [cell for cell in compared.cells if cell.role is not None]
    thin = [panel.in_words(cell.name) for cell in deciding if cell.status == "too_few_seeds"]
    if thin:
        return f"Fewer than {MIN_SEEDS} seeds in {', '.join(thin)}, which decides."
    lost = [cell for cell in deciding if cell.status != "win"]
    cells = "; ".join(
        f"on {panel.in_words(cell.name)}, in which no policy succeeds"
        if cell.status == "unsolved"
        else f"on {_difference_in(panel, cell, cell.p_win_adjusted)}"
        for cell in lost or deciding
    )
    if lost:
        return f"The win is not significant {cells}."
    return f"A wins {cells}, and no sign reverses in {informative} informative cells."


def _difference_in(panel: Panel, cell: CellFinding, p: float | None) -> str:
    difference = cell.difference.in_words(level=True)
    known = p_text(1.0 if p is None else p)
    return f"{panel.in_words(cell.name)}: A − B is {difference}, adjusted {known}"


def remedy_summary(panel: Panel, remedy: Remedy) -> str:
    """Whether a mixture holds where single discretizations lose, in sentences with numbers."""
    mixture = panel.in_words(remedy.row)
    if not panel.row(remedy.row).learned:
        return f"Policies trained on {mixture} did not learn, so they are no remedy here."
    solved = [cell for cell in remedy.cells if cell.solved]
    harmful = [cell for cell in solved if cell.lost]
    held = [cell for cell in harmful if cell.overfitting.estimate <= FAIL_MARGIN]
    if harmful:
        own = sum(cell.member for cell in held)
        trained = f", {own} of which they were trained in" if own else ""
        lost = [panel.in_words(cell.cell) for cell in harmful if cell not in held]
        rest = f"; they lose more in {', '.join(lost)}" if lost else ""
        summary = (
            f"In {len(harmful)} of the {len(solved)} discretizations that some policy solves, "
            f"policies trained on another single one lose more than {FAIL_MARGIN} of success by "
            f"overfitting; those trained on {mixture} lose no more than that in {len(held)} of "
            f"these{trained}{rest}."
        )
    else:
        summary = (
            f"No policy of a single discretization that learned loses more than {FAIL_MARGIN} by "
            f"overfitting anywhere, so there is nothing for {mixture} to remedy."
        )
    own_entry = panel.on_yardstick(remedy.row)
    singles = [e.success.estimate for row in remedy.singles if (e := panel.on_yardstick(row))]
    if own_entry is None or not singles:
        return summary
    return (
        f"{summary} {panel.at_yardstick.capitalize()} they succeed in "
        f"{percent(own_entry.success.estimate)} of the episodes, policies of single "
        f"discretizations in {percent(min(singles))} to {percent(max(singles))}."
    )


@dataclass(frozen=True)
class NextStep:
    """What to do next.

    Attributes:
        purpose: what it is for, as an instruction.
        command: what to type.
    """

    purpose: str
    command: str


def next_step(panel: Panel) -> NextStep | None:
    """What to do next; None where there is nothing to say."""
    finding = finding_of(panel)
    if finding is None:
        return None
    if panel.given_alone:
        return _next_of_given(panel, finding)
    if panel.check and (step := _next_of_check(panel, finding)) is not None:
        return step
    return _next_of_trained(panel, finding)


def _next_of_given(panel: Panel, finding: Finding) -> NextStep | None:
    row = panel.row(finding.row)
    if finding.status == "home_unknown":
        again = _again(panel, "--home", "integrator=…,dt=…,control_period=…")
        count = len(panel.looks)
        known = f"; this was look {count}, and all of them count there too" if count > 1 else ""
        return NextStep(f"Say what it was trained on{known}", again)
    compared = chain.from_iterable(_comparisons(panel, finding, row).values())
    seeming = any(is_open for *_, is_open in (_judge(panel, finding, row, x) for x in compared))
    if finding.status == "undecided" or (finding.status == "not_cause" and seeming):
        more = 4 * _starts(panel, row)
        return NextStep("Try more starts", _again(panel, "--episodes", more))
    if (
        finding.status == "home_decides"
        and panel.yardstick is None
        and "--spec" not in _split_command(panel.command)
    ):
        steps = sorted({cell.dt for cell in panel.columns}, reverse=True)
        return NextStep("Try a finer step", _again(panel, "--dt", *steps, steps[-1] / 2.0))
    if finding.status == "contract_error" and finding.home and finding.cell:
        return NextStep("See what differs", _contract(panel, finding.home, finding.cell))
    if row.dt is None or finding.home is None or finding.status == "closed":
        return None
    if not is_integ_environment(str(panel.spec.get("env_id"))):
        return _next_of_trained(panel, finding)  # stable-baselines3 would train for long
    if finding.status == "cause":
        return NextStep("Measure whether half the step is enough", _check(panel, row, 2))
    return NextStep("See whether other training seeds hold as well", _check(panel, row, 1))


def _next_of_check(panel: Panel, finding: Finding) -> NextStep | None:
    row, words = panel.row(finding.row), _split_command(panel.command)
    if words[:2] != ["integ-gym", "check"]:
        words = _split_command(_check(panel, row, 1))
    if finding.status == "not_learned" and row.training_steps is not None:
        for word in [word for word in words if word.startswith("total_steps=")]:
            place = words.index(word)
            del words[place - 1 : place + 1]
        longer = f"--train-arg total_steps={2 * row.training_steps}"
        return NextStep("Train longer", f"{_without(words, '--out')} {longer}")
    if finding.status != "cause" or row.dt is None or row.control_period is None:
        return None
    finer = f"--dt {row.dt / 2.0:g} --control-period {row.control_period:g}"
    again = _without(words, "--dt", "--control-period", "--out")
    return NextStep("See whether half the step is enough", f"{again} {finer}")


def _next_of_trained(panel: Panel, finding: Finding) -> NextStep:
    wanted = [one.seeds_wanted for one in _declared_verdicts(panel) if one.seeds_wanted]
    if finding.status == "undecided" and wanted:
        return NextStep("Train more seeds", f"{panel.command} --seeds {max(wanted)}")
    failed = next(
        (one for one in panel.failures if (one.row, one.cell) == (finding.row, finding.cell)), None
    )
    if finding.status in ("cause", "exploratory") and failed is not None:
        words = ["integ-gym", "watch", panel.directory, failed.record_id]
        return NextStep("See one episode fail", shlex.join(words))
    verify = shlex.join(["integ-gym", "evidence", "verify", panel.directory])
    return NextStep("Check every record", verify)


def _check(panel: Panel, row: Row, finer: int) -> str:
    """`integ-gym check` with the environment of a panel, at a row's step or a finer one."""
    assert row.dt is not None
    engine = panel.cell(str(row.home)).engine
    words = ["--integrator", str(row.integrator), "--dt", f"{row.dt / finer:g}"]
    if panel.truth is not None:
        if row.control_period is not None:
            words += ["--control-period", f"{row.control_period:g}"]
        words += [] if engine == NATIVE else ["--engine", engine]
    return _with_environment(panel, "check", words)


def _contract(panel: Panel, home: str, cell: str) -> str:
    """`integ-gym contract` of two cells."""
    places = [
        ",".join(f"{name}={x}" for name, x in panel.cell(one).discretization.arguments().items())
        for one in (home, cell)
    ]
    return _with_environment(panel, "contract", places)


def _with_environment(panel: Panel, command: str, words: Sequence[str]) -> str:
    """A command in the environment of a panel."""
    words = ["integ-gym", command, "--env", str(panel.spec.get("env_id")), *words]
    for name, value in panel.spec.get("environment", {}).items():
        words += ["--env-arg", f"{name}={value if isinstance(value, str) else json.dumps(value)}"]
    return shlex.join(words)


def _again(panel: Panel, option: str, *values: str | float) -> str:
    """The command that made an evaluation, with other values of one option.

    In the same directory, whose looks go on; a home is stated in another one, for records keep it.
    """
    texts = [value if isinstance(value, str) else f"{value:g}" for value in values]
    out, words = f"{panel.directory.rstrip('/')}-home", _split_command(panel.command)
    if "--out" not in words[:-1]:
        python = {"--dt": f"dts=[{', '.join(texts)}]", "--episodes": f"episodes={texts[0]}"}
        home = f"home={texts[0]!r}, out={out!r}"
        return f"integ_gym.evaluate(…, {python.get(option, home)})"
    if option == "--home":
        words[words.index("--out") + 1] = out
    return " ".join([_without(words, option), *(f"{option} {text}" for text in texts)])


def _without(words: Sequence[str], *options: str) -> str:
    """A command without some options and their values."""
    kept = list(words)
    for option in options:
        while option in kept:
            place = kept.index(option)
            del kept[place : place + 2]
    return shlex.join(kept)


def _split_command(command: str) -> list[str]:
    with suppress(ValueError):
        return shlex.split(command)
    return []
