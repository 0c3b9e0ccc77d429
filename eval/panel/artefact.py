"""From a plan and its records to the panel of `panel.json`, and how two panels differ."""

from __future__ import annotations

import hashlib
import json
import math
import shlex
from collections.abc import Iterator, Mapping, Sequence
from datetime import UTC, datetime
from typing import Any, Final

import msgspec

from integ_gym.envs.settings import Discretization
from integ_gym.support.processes import host, instruction_sets

from ..power import (
    WITHOUT_VERDICT,
    Judgement,
    judge_family,
    postponed,
    seeds_wanted,
)
from ..statistics import draws_for, rate_interval
from ..verdict import PolicyCell, compare_policies
from .cells import Cell
from .conclusions import answer_lines
from .findings import paired_episodes, rankings, remedies
from .matrix import Matrix, PanelLayout, Row
from .result import (
    FILE_NAME,
    EngineAgreement,
    Estimate,
    Failure,
    Panel,
    Policy,
    PolicyComparison,
    Verdict,
    build,
    read_panel,
)
from .result import Cell as PanelCell
from .result import Row as PanelRow
from .run_directory import RunDirectory

FAILURE_SAMPLE = 40
"""Failed episodes listed in the artefact; the evidence holds them all."""


def build_artefact(
    layout: PanelLayout,
    matrix: Matrix,
    policies: Mapping[str, Policy],
    files: Mapping[str, tuple[str, ...]],
    *,
    directory: str,
    training_steps: int | None = None,
    engine_agreement: tuple[EngineAgreement, ...] = (),
    undecided: str = "",
    **told: Any,
) -> Panel:
    """Everything that a panel found.

    Args:
        layout: rows and cells.
        matrix: outcomes.
        policies: by id.
        files: evidence files that hold the records of a policy, by id, beside ``panel.json``.
        directory: see :class:`Panel`.
        training_steps: decisions that each policy was trained for; None where none was.
        engine_agreement: see :class:`Panel`.
        undecided: why there are no verdicts yet, in a sentence; nothing where there are.
        told: attributes of :class:`Panel` that the outcome does not tell.
    """
    judgements, losses = _judge(layout, matrix), layout.losses(matrix)
    if undecided:
        judgements = tuple(postponed(judgement, undecided) for judgement in judgements)
    places = [(row, cell) for row in layout.rows for cell in layout.cells_of[row.name]]
    failures = [
        failure
        for row, cell in places
        if row.kind != "baseline"
        for failure in matrix.failures(row.name, cell)
    ]
    panel = Panel(
        **told,
        answer="",
        directory=directory,
        created=datetime.now(UTC).replace(microsecond=0),
        platform=host(),
        instruction_sets=instruction_sets(),
        weights=_weights(policies),
        rows=tuple(_row(row, matrix, policies, training_steps) for row in layout.rows),
        cells=tuple(_cell(cell, layout, matrix) for cell in layout.cells.values()),
        matrix=tuple(
            matrix.entry(
                row.name,
                cell,
                layout.native(cell),
                layout.reference_of(matrix, cell),
                losses.get((row.name, cell)),
                tuple(dict.fromkeys(file for policy in row.policies for file in files[policy])),
                _query(directory, row, cell),
            )
            for row, cell in places
        ),
        paired=paired_episodes(layout, matrix),
        verdicts=tuple(
            _verdict(
                judgement, *pair, None if undecided else _wanted(layout, matrix, judgements, k)
            )
            for k, (judgement, pair) in enumerate(zip(judgements, layout.family, strict=True))
        ),
        policy_comparisons=tuple(_compare(layout, matrix, a, b) for a, b in layout.compare),
        remedies=remedies(layout, matrix, losses),
        engine_agreement=engine_agreement,
        rankings=rankings(layout, matrix),
        failures=_spread([one for one in failures if matrix.has_trace(one.episode_index)]),
        failures_total=len(failures),
    )
    lines = (*([undecided] if undecided else []), *answer_lines(panel))
    return msgspec.structs.replace(panel, answer="\n".join(lines))


def _weights(policies: Mapping[str, Policy]) -> str:
    hashes = {name: policy.hash for name, policy in sorted(policies.items()) if policy.hash}
    return hashlib.sha256(json.dumps(hashes).encode()).hexdigest() if hashes else ""


def _verdict(judgement: Judgement, row: str, cell: str, wanted: int | None) -> Verdict:
    told = {name: value for name, value in vars(judgement).items() if name != "loss"}
    parts = vars(judgement.loss)
    return build(Verdict, row=row, cell=cell, seeds_wanted=wanted, **told, **parts)


def _wanted(
    layout: PanelLayout, matrix: Matrix, judgements: Sequence[Judgement], place: int
) -> int | None:
    """With how many seeds a verdict is to be expected where there is none for want of them."""
    if judgements[place].verdict != "inconclusive":
        return None
    tested = sum(judgement.verdict not in WITHOUT_VERDICT for judgement in judgements)
    rates = layout.rates(matrix, *layout.family[place])
    assert rates is not None
    return seeds_wanted(rates, tested, layout.looked)


def _judge(layout: PanelLayout, matrix: Matrix) -> tuple[Judgement, ...]:
    comparisons = [layout.comparison(matrix, row, cell) for row, cell in layout.family]
    return judge_family(comparisons, layout.looks_before) if comparisons else ()


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
    return build(PolicyComparison, a=a, b=b, **vars(compare_policies(cells, layout.share)))


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
        applied=layout.applied.get(cell.name),
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


ROUNDING: Final = 1e-6
"""By how much numbers may differ, relative to the larger of 1 and themselves: other processors and
versions add up in another order."""

VOLATILE: Final = ("created", "platform", "instruction_sets")
"""Attributes of a panel that say when and on what machine it was written, and nothing else."""

_CALLED: Final = ("command", "directory", "cost")
"""Attributes that say how the run was called, and what it took."""

_NAMES: Final = ("name", "row", "a", "b", "cell", "policy", "episode_index")
"""Keys that tell an entry of a list."""

_COMMAND: Final = ".query"
"""End of the places of commands, which name the directory."""

Difference = tuple[str, Any, Any]
"""Place, in words, what is said there, and what comes out."""


def differences(said: Panel, made: Panel) -> Iterator[Difference]:
    """What a panel says and is not what comes of its plan and records."""
    yield from _of_parts(said, made, VOLATILE)


def as_sealed(directory: RunDirectory, made: Panel) -> Panel:
    """The panel that a run was sealed with, where it says the same; else the one that was made."""
    if not directory.was_sealed:
        return made
    held = read_panel(directory.path / FILE_NAME)
    other = (place for place, *_ in _of_parts(held, made, (*VOLATILE, *_CALLED)))
    return made if any(not place.endswith(_COMMAND) for place in other) else held


def _of_parts(said: Panel, made: Panel, but: tuple[str, ...]) -> Iterator[Difference]:
    """What differs in all parts but some."""
    one, other = (msgspec.to_builtins(panel) for panel in (said, made))
    for part in one:
        if part not in but:
            yield from _differing(part, one[part], other[part])


def _differing(place: str, said: Any, made: Any) -> Iterator[Difference]:
    if isinstance(said, dict) and isinstance(made, dict):
        for key in {**said, **made}:
            yield from _differing(f"{place}.{key}", said.get(key), made.get(key))
    elif isinstance(said, list | tuple) and isinstance(made, list | tuple):
        if len(said) != len(made):
            yield f"len({place})", len(said), len(made)
            return
        for k, (one, other) in enumerate(zip(said, made, strict=True)):
            yield from _differing(f"{place}[{_named(one, k)}]", one, other)
    elif not _same(said, made):
        yield place, said, made


def _named(entry: Any, place: int) -> str:
    if not isinstance(entry, Mapping):
        return str(place)
    return ", ".join(str(entry[name]) for name in _NAMES if entry.get(name) is not None)


def _same(said: Any, made: Any) -> bool:
    if isinstance(said, float) or isinstance(made, float):
        numbers = isinstance(said, int | float) and isinstance(made, int | float)
        return numbers and math.isclose(said, made, rel_tol=ROUNDING, abs_tol=ROUNDING)
    return bool(said == made)
