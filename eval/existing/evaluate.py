"""The evaluation run, and its directory written."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from integ_gym.eval.artefact import Facts, build_artefact
from integ_gym.eval.evaluation import Subject
from integ_gym.eval.evaluation_units import batches_of, evaluate_batch, not_evaluated
from integ_gym.eval.existing.doubts import doubts
from integ_gym.eval.existing.policy import Existing
from integ_gym.eval.matrix import Matrix, Row
from integ_gym.eval.panel import nominal_setup
from integ_gym.eval.panel_artefact import (
    evaluation_records,
    facts_of,
    make_layout,
    shares_of,
    write_outputs,
)
from integ_gym.eval.panel_layout import PanelLayout
from integ_gym.eval.panel_model import Panel
from integ_gym.eval.panel_model import Policy as PanelPolicy
from integ_gym.eval.run_directory import RunDirectory
from integ_gym.eval.spec import PanelSpec
from integ_gym.evidence.atomic import replace_file
from integ_gym.train.baselines import make_baseline
from integ_gym.train.policy.interface import Policy
from integ_gym.train.sidecar import POLICY_FILE


def evaluate_existing(
    existing: Existing,
    spec: PanelSpec,
    out: Path,
    command: str,
    on_cell: Callable[[int], None] = lambda policies: None,
    on_doubt: Callable[[str], None] = lambda doubt: None,
) -> Panel:
    """Evaluate a policy and the baselines, and write the usual directory.

    Args:
        existing: the policy.
        spec: what :func:`~integ_gym.eval.existing.plan.plan` made.
        out: directory.
        command: how to run this again, for the page.
        on_cell: told after every cell how many policies were in it.
        on_doubt: called first, with each sentence that casts doubt on the result.

    Returns:
        What ``panel.json`` holds; ``warnings`` lists the doubts.

    Raises:
        RunDirectoryError: for a directory that holds something else.
    """
    directory = directory_of(existing, spec, out)
    baselines = [make_baseline(name, nominal_setup(spec)) for name in spec.baselines]
    with directory.opened():
        warnings = doubts(existing, spec)
        for doubt in warnings:
            on_doubt(doubt)
        for batch in batches_of(spec, begin(existing, spec, directory, baselines, on_cell), 1):
            evaluate_batch(spec, directory, batch, lambda _, policies: on_cell(policies))
        layout, matrix = outcome(existing, spec, directory)
        facts = evaluation_facts(existing, spec, directory, command, warnings=warnings)
        panel = build_artefact(layout, matrix, facts)
        write_outputs(panel, directory)
    return panel


def directory_of(existing: Existing, spec: PanelSpec, out: Path) -> RunDirectory:
    """The directory of one policy's evaluation; another policy in it is refused."""
    content = {**spec.to_json(), "policy": existing.policy.content_hash}
    return RunDirectory(out, content, spec.engine_versions())


def begin(
    existing: Existing,
    spec: PanelSpec,
    directory: RunDirectory,
    baselines: Sequence[Policy],
    on_cell: Callable[[int], None],
) -> list[Subject]:
    """Keep the policy's files, and tell which of the policies have not been evaluated yet.

    Args:
        existing: the policy.
        spec: the evaluation.
        directory: held by the caller.
        baselines: policies beside it.
        on_cell: told how many cells are done already.
    """
    for name, source in existing.files.items():
        replace_file(directory.policies / existing.policy.policy_id / name, source.read_bytes())
    subjects = [
        Subject(existing.policy, spec.cells_of(existing.home), existing.home),
        *(Subject(baseline, spec.cells_of(None)) for baseline in baselines),
    ]
    waiting = not_evaluated(spec, directory, subjects)
    on_cell(sum(len(subject.cells) for subject in subjects if subject not in waiting))
    return waiting


def outcome(
    existing: Existing, spec: PanelSpec, directory: RunDirectory
) -> tuple[PanelLayout, Matrix]:
    """Rows and cells of a finished evaluation, and what came out."""
    homes = {existing.policy.policy_id: existing.home}
    layout = make_layout(spec, _rows(existing, spec), homes)
    return layout, Matrix(layout.rows, evaluation_records(directory), spec.episodes)


def _rows(existing: Existing, spec: PanelSpec) -> tuple[Row, ...]:
    row = existing.policy.policy_id
    return (
        Row(row, "given", (row,), shares_of(existing.home)),
        *(Row(name, "baseline", (name,)) for name in spec.baselines),
    )


def evaluation_facts(
    existing: Existing,
    spec: PanelSpec,
    directory: RunDirectory,
    command: str,
    workers: int = 1,
    **more: Any,
) -> Facts:
    """What the panel says of the evaluation beside its outcome; ``more`` as of `facts_of`."""
    row = existing.policy.policy_id
    own = PanelPolicy(
        id=row,
        seed=existing.seed,
        hash=existing.policy.content_hash,
        file=f"policies/{row}/{POLICY_FILE}",
    )
    others = {n: PanelPolicy(id=n) for n in spec.baselines}
    stated = {**spec.to_json(), "home": existing.origin}
    return facts_of(spec, directory, command, workers, {row: own, **others}, spec=stated, **more)
