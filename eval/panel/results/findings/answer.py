"""The panel's question, answered in one sentence with numbers."""

from __future__ import annotations

from collections.abc import Sequence

from integ_gym.support import percent

from ....verdict import EQUIVALENCE_MARGIN, WITHOUT_VERDICT, Judgement
from ...model import Panel
from ..layout import PanelLayout
from ..matrix import Matrix
from .engine_agreement import agreement_answer
from .exploring import exploratory_answer, unlearned_answer


def answer_of(
    layout: PanelLayout,
    matrix: Matrix,
    judgements: Sequence[Judgement],
    panel: Panel,
) -> str:
    """What the judgements of the declared family come to, or what there is to say without any.

    Args:
        layout: rows and cells.
        matrix: outcomes.
        judgements: of the declared family.
        panel: all else that was found.
    """
    judged = [
        (judgement, pair)
        for judgement, pair in zip(judgements, layout.family, strict=True)
        if judgement.verdict not in WITHOUT_VERDICT
    ]
    if not judged:
        if judgements:
            return _unjudged_answer(judgements, layout, matrix)
        if told := agreement_answer(panel.engine_agreement):
            return told
        if explored := exploratory_answer(panel):
            return explored + _unreached(layout, matrix)
        return _range_answer(layout, matrix)
    failed = [one for one in judged if one[0].verdict == "fails"]
    worst, pair = max(failed or judged, key=lambda one: one[0].loss.overfitting.estimate)
    fails, unreached = len(failed), _unreached(layout, matrix)
    some = len(judged) < len(judgements)
    declared = "declared transfers" + (" that can be judged" if some else "")
    holds = sum(judgement.verdict == "transfers" for judgement, _ in judged)
    if holds == len(judged):
        late = _lost_otherwise(judged, matrix)
        return f"Yes: all {holds} {declared} hold within ±0.1 success.{late}{unreached}"
    verdict = "No" if fails else "Not shown either way"
    return (
        f"{verdict}: of {len(judged)} {declared} {fails} fail and {holds} hold; "
        f"{_most(worst, pair, matrix)}.{unreached}"
    )


def _unreached(layout: PanelLayout, matrix: Matrix) -> str:
    """Cells that cannot be solved in time, in a sentence after a space; nothing without any."""
    statuses = {cell: layout.achieved(matrix, cell).status for cell in layout.columns()}
    named = {
        words: [cell for cell, own in statuses.items() if own == status]
        for status, words in (
            ("unachievable", "cannot be solved by any control that was found"),
            ("too_slow", "can be solved in twice the time alone"),
            ("undecided", "may be solvable or not: nobody does, and no search rules it out"),
        )
    }
    return "".join(f" {', '.join(cells)} {words}." for words, cells in named.items() if cells)


def _most(judgement: Judgement, pair: tuple[str, str], matrix: Matrix) -> str:
    """The largest loss in words."""
    row, cell = pair
    home = matrix.home_rates(row)
    assert home is not None
    at_home, there = home.mean(), matrix.rates(row, cell).mean()
    loss = judgement.loss
    return (
        f"the most is lost by overfitting to {row}: success is {at_home:.2f} at home and "
        f"{there:.2f} on {cell} (overfitting {loss.overfitting}, deadline "
        f"{loss.deadline.estimate:z.2f}, difficulty {loss.difficulty.estimate:z.2f})"
    )


def _lost_otherwise(judged: Sequence[tuple[Judgement, tuple[str, str]]], matrix: Matrix) -> str:
    """The largest loss that is no overfitting, in a sentence after a space; nothing if small."""
    loss, (row, cell) = max(
        ((judgement.loss, pair) for judgement, pair in judged),
        key=lambda one: one[0].deadline.estimate + one[0].difficulty.estimate,
    )
    deadline, difficulty = loss.deadline, loss.difficulty
    if deadline.estimate + difficulty.estimate < EQUIVALENCE_MARGIN:
        return ""
    home = matrix.home_rates(row)
    assert home is not None
    return (
        f" What is lost otherwise is most of {row} on {cell}: success is {home.mean():.2f} at home "
        f"and {matrix.rates(row, cell).mean():.2f} there (deadline {deadline}, difficulty "
        f"{difficulty.estimate:z.2f})."
    )


def _unjudged_answer(judgements: Sequence[Judgement], layout: PanelLayout, matrix: Matrix) -> str:
    """What to say where no declared transfer can be judged."""
    rows = dict.fromkeys(row for row, _ in layout.family)
    if any(judgement.verdict != "not_learned" for judgement in judgements):
        return (
            "Not answered: no declared transfer can be judged, for the want of policies that learn "
            f"or of cells that are known to be solvable in time.{_unreached(layout, matrix)}"
        )
    home = {
        row: float(rates.mean()) for row in rows if (rates := matrix.home_rates(row)) is not None
    }
    return unlearned_answer("no policies of the declared transfers have learned", home)


def _range_answer(layout: PanelLayout, matrix: Matrix) -> str:
    row = layout.rows[0].name
    columns = [n for n in layout.cells_of[row] if layout.cells[n].kind in ("grid", "reference")]
    rates = {name: float(matrix.rates(row, name).mean()) for name in columns}
    low, high = min(rates, key=lambda n: rates[n]), max(rates, key=lambda n: rates[n])
    if rates[low] == rates[high]:
        among = f", {_truth(layout)} among them" if layout.reference else ""
        if not rates[low]:
            return f"{row} succeeds on none of {len(rates)} discretizations{among}."
        return (
            f"{row} succeeds in {percent(rates[low])} of episodes on each of {len(rates)} "
            f"discretizations{among}."
        )
    anchor, where = layout.reference, "its home"
    if anchor is None:
        anchor = next(iter(layout.rows[0].shares), None)
    else:
        where = _truth(layout)
    between = (
        f"over {len(rates)} discretizations between {percent(rates[low])} ({low}) and "
        f"{percent(rates[high])} ({high})."
    )
    if anchor is None:
        return f"{row}, whose home is unknown, succeeds {between}"
    return f"{row} succeeds in {percent(rates[anchor])} of episodes on {where}; {between}"


def _truth(layout: PanelLayout) -> str:
    """What decides, with the name that it has as data."""
    assert layout.reference is not None
    return f"the truth (integrator {layout.cells[layout.reference].discretization.integrator})"
