"""From a plan and its records to the panel of `panel.json`, and how two panels differ."""

from __future__ import annotations

import hashlib
import json
import shlex
from collections.abc import Iterator, Mapping, Sequence
from datetime import UTC, datetime
from itertools import starmap
from typing import Any, Final

import msgspec

from integ_gym.evidence.store import sql_literal
from integ_gym.support.processes import host, instruction_sets

from ..power import WITHOUT_VERDICT, Verdict, judge_family, postpone, seeds_wanted
from ..verdict import PolicyCell, PolicyComparison, compare_policies
from . import result
from .cells import Cell
from .checking.comparing import ROUNDING, find_differences
from .findings import limits, paired_episodes, rankings, remedies, separations
from .limit import entry_at_limit
from .matrix import Matrix, PanelLayout, mean_success
from .run_directory import RunDirectory

FAILURE_SAMPLE = 40
"""Failed episodes listed in the artefact; the evidence holds them all."""


def build_artefact(
    layout: PanelLayout,
    matrix: Matrix,
    files: Mapping[str, tuple[str, ...]],
    *,
    directory: str,
    training_steps: int | None = None,
    stage: result.Stage | None = None,
    **other: Any,
) -> result.Panel:
    """Everything that a panel found.

    Args:
        layout: rows and cells.
        matrix: outcomes.
        files: evidence files that hold the records of a policy, by id, beside ``panel.json``.
        directory: see :class:`Panel`.
        training_steps: decisions that each policy was trained for; None where none was.
        stage: see :class:`Panel`; there are no verdicts yet where it is given.
        other: attributes of :class:`Panel` that the outcome does not tell.
    """
    losses, at_limit = layout.losses(matrix), limits(layout, matrix)
    called = result.limits_called(at_limit, layout.rows)
    at = {(one.row, one.cell): one for one in at_limit if one.cell in called}
    places = [(row, cell) for row in layout.rows for cell in layout.cells_of[row.name]]
    failures = [
        failure
        for row, cell in places
        if not row.baseline
        for failure in matrix.failures(row.name, cell)
    ]
    known = [(p.id, p.hash) for row in layout.rows for p in row.policies if p.hash]
    hashes = dict(sorted(known))

    def entry(row: result.Row, cell: str) -> result.Entry:
        """What a row did in a cell; no loss, gap or class where the contract is not kept."""
        kept = (row.name, cell) not in layout.broken
        found = matrix.entry(
            row.name,
            cell,
            layout.native(cell) if kept else None,
            layout.reference_of(matrix, cell, called) if kept else None,
            losses.get((row.name, cell)) if kept else None,
            tuple(dict.fromkeys(file for p in row.policy_ids for file in files[p])),
            _query(directory, row, cell),
        )
        return entry_at_limit(found, at.get((row.name, cell)))

    return result.Panel(
        **other,
        stage=stage,
        directory=directory,
        created=datetime.now(UTC).replace(microsecond=0),
        platform=host(),
        instruction_sets=instruction_sets(),
        weights=hashlib.sha256(json.dumps(hashes).encode()).hexdigest() if hashes else "",
        rows=tuple(_row(row, matrix, training_steps) for row in layout.rows),
        cells=tuple(_cell(cell, layout, matrix) for cell in layout.cells.values()),
        matrix=tuple(starmap(entry, places)),
        contracts=tuple(layout.contracts.values()),
        limits=at_limit,
        paired=paired_episodes(layout, matrix, called),
        verdicts=_verdicts(layout, matrix, decided=stage is None),
        policy_comparisons=tuple(_compare(layout, matrix, a, b) for a, b in layout.compare),
        separations=separations(layout, matrix),
        remedies=remedies(layout, matrix, losses),
        rankings=rankings(layout, matrix),
        failures=_spread([one for one in failures if matrix.has_trace(one.episode_index)]),
        failures_total=len(failures),
    )


def _verdicts(layout: PanelLayout, matrix: Matrix, *, decided: bool) -> tuple[Verdict, ...]:
    """Verdicts on the family, with how many seeds are to be expected to decide what is open."""
    family = [layout.comparison(matrix, row, cell) for row, cell in layout.family]
    verdicts = judge_family(family, layout.looks_before) if family else ()
    if not decided:
        return tuple(map(postpone, verdicts))
    tested = sum(verdict.verdict not in WITHOUT_VERDICT for verdict in verdicts)
    return tuple(
        msgspec.structs.replace(
            verdict, seeds_wanted=seeds_wanted(one.rates, tested, layout.looks_so_far)
        )
        if verdict.verdict == "inconclusive"
        else verdict
        for one, verdict in zip(family, verdicts, strict=True)
    )


def _compare(layout: PanelLayout, matrix: Matrix, a: str, b: str) -> PolicyComparison:
    """Policies of two rows, compared in every grid cell and on the reference.

    The finest step of both rows' own integrators decides, and so does the reference.
    """
    homes = [layout.cells[name] for row in (a, b) for name in matrix.rows[row].shares]
    own = {(home.engine, home.integrator) for home in homes}
    cells = []
    for name in layout.cells_of[a]:
        cell = layout.cells[name]
        if cell.kind not in ("grid", "reference") or name not in layout.cells_of[b]:
            continue
        if {(a, name), (b, name)} & layout.broken:
            continue
        decides = cell.role != "quarter_step" or (cell.engine, cell.integrator) in own
        rates = matrix.rates(a, name), matrix.rates(b, name)
        cells.append(PolicyCell(name, *rates, cell.role if decides else None))
    return compare_policies(cells, layout.share, a=a, b=b)


def _row(row: result.Row, matrix: Matrix, training_steps: int | None) -> result.Row:
    """A row with what came out."""
    rates = matrix.home_rates(row.name)
    return msgspec.structs.replace(
        row,
        home_success=None if rates is None else mean_success(rates),
        learned=matrix.learned(row.name),
        training_steps=training_steps if row.kind == "trained" else None,
    )


def _cell(cell: Cell, layout: PanelLayout, matrix: Matrix) -> Cell:
    """A cell with what was applied and whether it can be solved."""
    applied = layout.applied.get(cell.name)
    if cell.name not in layout.columns():
        return msgspec.structs.replace(cell, applied=applied)
    can = layout.achieved(matrix, cell.name)
    return msgspec.structs.replace(
        cell, applied=applied, achievability=can.status, best=can.best, search=can.search
    )


def _query(directory: str, row: result.Row, cell: str) -> str:
    """The command that lists the records behind an entry."""
    policies = ", ".join(sql_literal(policy) for policy in row.policy_ids)
    sql = (
        "SELECT record_id, episode_index, success, failure_label FROM records "
        f"WHERE cell = {sql_literal(cell)} AND policy_id IN ({policies})"
    )
    return shlex.join(["integ-gym", "evidence", "query", directory, sql])


def _spread(failures: Sequence[result.Failure]) -> tuple[result.Failure, ...]:
    """A sample that takes turns between cells and labels, in a fixed order."""
    groups: dict[tuple[str, str, str], list[result.Failure]] = {}
    for failure in failures:
        groups.setdefault((failure.label, failure.row, failure.cell), []).append(failure)
    sample: list[result.Failure] = []
    depth = 0
    while len(sample) < min(FAILURE_SAMPLE, len(failures)):
        layer = [group[depth] for group in groups.values() if len(group) > depth]
        step = max(1, len(layer) // FAILURE_SAMPLE)
        sample += layer[::step][: FAILURE_SAMPLE - len(sample)]
        depth += 1
    return tuple(sample)


VOLATILE: Final = ("created", "platform", "instruction_sets")
"""Attributes of a panel that say when and on what machine it was written, and nothing else."""

_CALLED: Final = ("command", "directory", "cost")
"""Attributes that say how the run was called, and what it took."""


_ADDED: Final = ("command_error", "terminated")
"""Attributes of entries that no entry has in a file from before there were any."""

_COMMAND: Final = ".query"
"""End of the places of commands, which name the directory."""


def differences(
    said: Mapping[str, Any], panel: result.Panel, but: tuple[str, ...] = VOLATILE
) -> Iterator[tuple[str, Any, Any]]:
    """What ``panel.json`` says and is not what comes of its plan and records.

    Place, in words, what is said there, and what comes out.

    Args:
        said: content of the file.
        panel: what comes out.
        but: attributes that are not compared.
    """
    left_out = dict.fromkeys(but)
    come = {**msgspec.to_builtins(panel), **left_out}
    unsaid = {name for name in _ADDED if not any(name in entry for entry in said["matrix"])}
    come["matrix"] = [{k: x for k, x in one.items() if k not in unsaid} for one in come["matrix"]]
    yield from find_differences("", {**said, **left_out}, come, ROUNDING)


def as_sealed(directory: RunDirectory, panel: result.Panel) -> result.Panel:
    """The panel that a run was sealed with, where it says the same; else the one that was made."""
    if not directory.was_sealed:
        return panel
    try:
        held = result.read_panel(directory.path / result.FILE_NAME)
    except result.OtherVersionError:
        return panel
    sealed = msgspec.to_builtins(held)
    other = (place for place, *_ in differences(sealed, panel, (*VOLATILE, *_CALLED)))
    return panel if any(not place.endswith(_COMMAND) for place in other) else held
