"""The evaluation run, and its directory written."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

from integ_gym.evidence import EvidenceStore
from integ_gym.support import cores, replace_file
from integ_gym.train import POLICY_FILE, Policy

from ..model import Panel
from ..model import Policy as PanelPolicy
from ..results import Matrix, Row, cost_of, reduced, write_outputs
from ..running import RunDirectory, Subject, baseline_of, evaluate_all, evaluation_seconds
from ..specification import Cell, PanelSpec
from .planning import main_home
from .policy import Existing

SHORT = 10.0
"""Expected work that is not worth starting worker processes for, s."""


def evaluate_existing(
    existing: Existing,
    spec: PanelSpec,
    out: Path,
    command: str,
    *,
    progress: bool = False,
    on_doubt: Callable[[str], None] = lambda doubt: None,
) -> Panel:
    """Evaluate a policy and the baselines, and write the usual directory.

    Args:
        existing: the policy.
        spec: what :func:`~integ_gym.eval.panel.existing.planning.plan` made.
        out: directory; one that holds another policy's evaluation is refused.
        command: how to run this again, for the page.
        progress: show a bar.
        on_doubt: called at the end, with each sentence that casts doubt on the result.

    Returns:
        What ``panel.json`` holds; ``warnings`` lists the doubts.

    Raises:
        RunDirectoryError: for a directory that holds something else.
        PanelError: if an evaluation fails; what was finished stays.
    """
    row, home = existing.policy.policy_id, existing.home
    content = {**spec.to_json(), "policy": existing.policy.content_hash}
    directory = RunDirectory(out, content, spec.engine_versions())
    subjects = [
        Subject(existing.policy, spec.cells_of(home), home),
        *(Subject(baseline_of(spec, name), spec.cells_of(None)) for name in spec.baselines),
    ]
    workers = 0 if evaluation_seconds(spec, subjects) < SHORT else cores()
    with directory.opened():
        for name, source in existing.files.items():
            replace_file(directory.policies / row / name, source.read_bytes())
        evaluate_all(spec, directory, subjects, "evaluate", workers, progress)
        baselines = (Row(name, "baseline", (name,)) for name in spec.baselines)
        layout, matrix = reduced(spec, directory, (Row(row, "given", (row,), home), *baselines))
        panel = write_outputs(
            spec,
            directory,
            layout,
            matrix,
            [_told(existing, subject.policy) for subject in subjects],
            command=command,
            cost=cost_of(directory, (), max(1, workers)),
            spec={**spec.to_json(), "home": existing.origin},
            remark="" if spec.reference else _returns(existing, spec, matrix),
            warnings=(
                *_no_better(existing, matrix),
                *_cannot_fail(spec, EvidenceStore(directory.evidence)),
            ),
        )
    for doubt in panel.warnings:
        on_doubt(doubt)
    return panel


def _told(existing: Existing, policy: Policy) -> PanelPolicy:
    """What the panel says of a policy; of a baseline no more than its name."""
    name = policy.policy_id
    if policy is not existing.policy:
        return PanelPolicy(id=name, seed=None, hash=None, file=None)
    file = f"policies/{name}/{POLICY_FILE}"
    return PanelPolicy(id=name, seed=existing.seed, hash=policy.content_hash, file=file)


def _home_cell(existing: Existing) -> str:
    return Cell(main_home(existing.home), "grid").name


def _returns(existing: Existing, spec: PanelSpec, matrix: Matrix) -> str:
    """The range of the policy's returns in one sentence."""
    row, home = existing.policy.policy_id, _home_cell(existing)
    cells = [cell.name for cell in spec.columns()]
    means = {name: float(matrix.values(row, name, "return").mean()) for name in cells}
    low, high = min(means, key=lambda n: means[n]), max(means, key=lambda n: means[n])
    if means[low] == means[high]:
        return f"Its mean return is {means[home]:.1f} on each of them."
    return (
        f"Its mean return is {means[home]:.1f} at home, and between {means[low]:.1f} ({low}) and "
        f"{means[high]:.1f} ({high})."
    )


def _no_better(existing: Existing, matrix: Matrix) -> list[str]:
    """Doubt where the policy is no better than random on its own discretization."""
    home = _home_cell(existing)
    own, chance = (
        matrix.values(row, home, "return")[0] for row in (existing.policy.policy_id, "random")
    )
    difference = own - chance
    error = float(difference.std(ddof=1)) / math.sqrt(len(difference)) if len(own) > 1 else 0.0
    if difference.mean() > 2.0 * error:
        return []
    better = "no better than" if difference.mean() <= 0 else "not shown to be better than"
    remedy = (
        "trained with VecNormalize? pass --obs-stats FILE.json"
        if existing.seed is None
        else "was it trained for long enough?"
    )
    return [
        f"on its home discretization ({home}) the policy's return {own.mean():.1f} over "
        f"{len(own)} episodes is {better} random's {chance.mean():.1f}; {remedy}"
    ]


def _cannot_fail(spec: PanelSpec, records: EvidenceStore) -> list[str]:
    """Doubt where success is survival, and everybody survives."""
    success = spec.testbed.success
    if success.parameter is None or success.parameter in spec.environment:
        return []
    if records.query("SELECT record_id FROM records WHERE terminated LIMIT 1").num_rows:
        return []
    solved, flag = success.suggested, f"--{success.parameter.replace('_', '-')} R"
    suggestion = "" if solved is None else f" (Gymnasium calls the task solved at {solved:g})"
    return [
        "no episode of any row ends before its time limit, so success, which is survival, tells "
        f"nothing here: compare returns, or give {flag}{suggestion}"
    ]
