"""From rows, cells and outcomes to the panel that ``panel.json`` holds."""

from __future__ import annotations

import platform
import shlex
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from typing import Any

from integ_gym.envs import Discretization

from ...statistics import draws_for, rate_interval
from ...verdict import (
    LEARNED,
    WITHOUT_VERDICT,
    Judgement,
    PolicyCell,
    compare_policies,
    judge_family,
)
from ..model import Cell as PanelCell
from ..model import (
    EngineAgreement,
    Estimate,
    Failure,
    Panel,
    Policy,
    PolicyComparison,
    Verdict,
    build,
)
from ..model import Row as PanelRow
from ..specification import Cell
from .engine_agreement import agreement_answer
from .layout import PanelLayout
from .matrix import Matrix, Row
from .paired import paired_episodes
from .remedy import remedies

FAILURE_SAMPLE = 40
"""Failed episodes listed in the artefact; the evidence holds them all."""


def build_artefact(
    layout: PanelLayout,
    matrix: Matrix,
    policies: Mapping[str, Policy],
    files: Mapping[str, str],
    *,
    directory: str,
    training_steps: int | None = None,
    engine_agreement: tuple[EngineAgreement, ...] = (),
    remark: str = "",
    **told: Any,
) -> Panel:
    """Everything that a panel found.

    Args:
        layout: rows and cells.
        matrix: outcomes.
        policies: by id.
        files: evidence file that holds the records of a policy, by id, beside ``panel.json``.
        directory: see :class:`Panel`.
        training_steps: decisions that each policy was trained for; None where none was.
        engine_agreement: see :class:`Panel`.
        remark: a sentence that is added to the answer.
        told: attributes of :class:`Panel` that the outcome does not tell.
    """
    judgements = _judge(layout, matrix)
    failures = [
        failure
        for row in layout.rows
        if row.kind != "baseline"
        for cell in layout.cells_of[row.name]
        for failure in matrix.failures(row.name, cell)
    ]
    answer = _answer(layout, matrix, judgements, engine_agreement)
    return Panel(
        **told,
        answer=f"{answer} {remark}".rstrip(),
        directory=directory,
        created=datetime.now(UTC).replace(microsecond=0),
        platform=platform.platform(),
        rows=tuple(_row(row, matrix, policies, training_steps) for row in layout.rows),
        cells=tuple(_cell(cell, layout, matrix) for cell in layout.cells.values()),
        matrix=tuple(
            matrix.entry(
                row.name,
                cell,
                layout.native(cell),
                layout.reference_of(cell),
                layout.loss(matrix, row.name, cell),
                tuple(dict.fromkeys(files[policy] for policy in row.policies)),
                _query(directory, row, cell),
            )
            for row in layout.rows
            for cell in layout.cells_of[row.name]
        ),
        paired=paired_episodes(layout, matrix),
        verdicts=tuple(
            _verdict(judgement, *pair)
            for judgement, pair in zip(judgements, layout.family, strict=True)
        ),
        policy_comparisons=tuple(_compare(layout, matrix, a, b) for a, b in layout.compare),
        remedies=remedies(layout, matrix),
        engine_agreement=engine_agreement,
        failures=_spread(failures),
        failures_total=_failed(layout, matrix),
    )


def _failed(layout: PanelLayout, matrix: Matrix) -> int:
    """Failed episodes of all rows that are no baselines, with a trace or without."""
    return sum(
        int((matrix.values(row.name, cell, "success") == 0.0).sum())
        for row in layout.rows
        if row.kind != "baseline"
        for cell in layout.cells_of[row.name]
    )


def _verdict(judgement: Judgement, row: str, cell: str) -> Verdict:
    told = {name: value for name, value in vars(judgement).items() if name != "loss"}
    return build(Verdict, row=row, cell=cell, **told, **vars(judgement.loss))


def _judge(layout: PanelLayout, matrix: Matrix) -> tuple[Judgement, ...]:
    comparisons = [layout.comparison(matrix, row, cell) for row, cell in layout.family]
    return judge_family(comparisons) if comparisons else ()


def _compare(layout: PanelLayout, matrix: Matrix, a: str, b: str) -> PolicyComparison:
    """Policies of two rows, compared in every grid cell and on the reference.

    The finest step of both rows' own integrators decides, and so does the reference.
    """
    homes = [home for row in (a, b) if (home := matrix.rows[row].trained_on)]
    own = {(d.engine, d.integrator) for home in homes for d in home.shares}
    cells = []
    for name in layout.cells_of[a]:
        cell = layout.cells[name]
        if cell.kind not in ("grid", "reference") or name not in layout.cells_of[b]:
            continue
        role: Any = cell.role
        place = cell.discretization
        if role == "quarter_step" and (place.engine, place.integrator) not in own:
            role = None
        cells.append(PolicyCell(name, matrix.rates(a, name), matrix.rates(b, name), role))
    return build(PolicyComparison, a=a, b=b, **vars(compare_policies(cells)))


def _row(
    row: Row, matrix: Matrix, policies: Mapping[str, Policy], training_steps: int | None
) -> PanelRow:
    home = row.trained_on if isinstance(row.trained_on, Discretization) else None
    rates = matrix.home_rates(row.name)
    return PanelRow(
        name=row.name,
        kind=row.kind,
        home=row.home,
        shares=row.shares,
        integrator=home.integrator if home else None,
        dt=home.dt if home else None,
        control_period=row.trained_on.control_period if row.trained_on else None,
        seeds=len(row.policies),
        policies=tuple(policies[policy] for policy in row.policies),
        home_success=None
        if rates is None
        else Estimate.of(rate_interval(rates, draws=draws_for(len(rates)))),
        learned=matrix.learned(row.name),
        training_steps=training_steps if row.kind == "trained" else None,
    )


def _cell(cell: Cell, layout: PanelLayout, matrix: Matrix) -> PanelCell:
    can = layout.achieved(matrix, cell.name) if cell.name in layout.columns() else None
    return build(
        PanelCell,
        name=cell.name,
        **cell.discretization.arguments(),
        kind=cell.kind,
        perturbation=cell.perturbation.name if cell.perturbation else None,
        role=cell.role,
        achievability=can and can.status,
        achievability_reason=can and can.reason,
    )


def _query(directory: str, row: Row, cell: str) -> str:
    """The command that lists the records behind an entry."""
    policies = ", ".join(_quoted(policy) for policy in row.policies)
    sql = (
        "SELECT record_id, episode_index, success, failure_label FROM records "
        f"WHERE cell = {_quoted(cell)} AND policy_id IN ({policies})"
    )
    return shlex.join(["integ-gym", "evidence", "query", directory, sql])


def _quoted(text: str) -> str:
    """A string literal of SQL."""
    return "'" + text.replace("'", "''") + "'"


def _spread(failures: Sequence[Failure]) -> tuple[Failure, ...]:
    """A sample that takes turns between cells and labels, in a fixed order."""
    groups: dict[tuple[str, str, str], list[Failure]] = {}
    for failure in failures:
        groups.setdefault((failure.label, failure.row, failure.cell), []).append(failure)
    sample: list[Failure] = []
    depth = 0
    while len(sample) < min(FAILURE_SAMPLE, len(failures)):
        layer = [group[depth] for group in groups.values() if len(group) > depth]
        step = max(1, len(layer) // FAILURE_SAMPLE)
        sample += layer[::step][: FAILURE_SAMPLE - len(sample)]
        depth += 1
    return tuple(sample)


def _answer(
    layout: PanelLayout,
    matrix: Matrix,
    judgements: Sequence[Judgement],
    agreement: Sequence[EngineAgreement],
) -> str:
    """The panel's question answered in one sentence with numbers."""
    judged = [
        (judgement, pair)
        for judgement, pair in zip(judgements, layout.family, strict=True)
        if judgement.verdict not in WITHOUT_VERDICT
    ]
    if not judged:
        if judgements:
            return _unjudged_answer(judgements, layout, matrix)
        return agreement_answer(agreement) or _range_answer(layout, matrix)
    failed = [one for one in judged if one[0].verdict == "fails"]
    worst, pair = max(failed or judged, key=lambda one: one[0].loss.overfitting.estimate)
    fails, unreached = len(failed), _unreached(layout, matrix)
    some = len(judged) < len(judgements)
    declared = "declared transfers" + (" that can be judged" if some else "")
    holds = sum(judgement.verdict == "transfers" for judgement, _ in judged)
    if holds == len(judged):
        return f"Yes: all {holds} {declared} hold within ±0.1 success.{unreached}"
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
    best = max(home, key=lambda row: home[row])
    return (
        "Not answered: no policies of the declared transfers have learned, which takes a success "
        f"of {LEARNED} at home; those trained on {best} come nearest, with {home[best]:.2f}. Train "
        "longer (`total_steps` in [training]), or set an easier task."
    )


def _range_answer(layout: PanelLayout, matrix: Matrix) -> str:
    row = layout.rows[0].name
    columns = [n for n in layout.cells_of[row] if layout.cells[n].kind in ("grid", "reference")]
    rates = {name: float(matrix.rates(row, name).mean()) for name in columns}
    low, high = min(rates, key=lambda n: rates[n]), max(rates, key=lambda n: rates[n])
    if rates[low] == rates[high]:
        return (
            f"{row} succeeds in {rates[low]:.0%} of episodes on each of {len(rates)} "
            f"discretizations{', the reference among them' if layout.reference else ''}."
        )
    anchor, where = layout.reference, "the reference"
    if anchor is None:
        anchor, where = next(iter(layout.rows[0].shares), None), "its home"
    between = (
        f"over {len(rates)} discretizations between {rates[low]:.0%} ({low}) and "
        f"{rates[high]:.0%} ({high})."
    )
    if anchor is None:
        return f"{row}, whose home is unknown, succeeds {between}"
    return f"{row} succeeds in {rates[anchor]:.0%} of episodes on {where}; {between}"
