"""The evaluation run, and its directory written."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from integ_gym.evidence import EvidenceStore
from integ_gym.support import (
    Cluster,
    Storage,
    check_spawning,
    cores,
    installed_versions,
    replace_file,
)
from integ_gym.train import HOW_TO_STATE, Policy

from ..checking import check_records
from ..model import Panel
from ..model import Policy as PanelPolicy
from ..results import (
    Matrix,
    cost_of,
    given_remark,
    given_rows,
    home_cell,
    reduced,
    write_outputs,
)
from ..running import (
    RunDirectory,
    Subject,
    all_seconds,
    as_there,
    baseline_of,
    evaluate_all,
)
from ..sharing import evaluate_on, write_pages
from ..specification import TRAINERS, PanelSpec
from .policy import Existing

SHORT = 10.0
"""Expected work that is not worth starting worker processes for, s."""


def evaluate_existing(
    existing: Existing,
    spec: PanelSpec,
    out: Path | Storage,
    command: str,
    *,
    workers: int | None = None,
    progress: bool = False,
    on_doubt: Callable[[str], None] = lambda doubt: None,
    cluster: Cluster | None = None,
) -> Panel:
    """Evaluate a policy and the baselines, and write the usual directory.

    Args:
        existing: the policy.
        spec: what :func:`~integ_gym.eval.panel.existing.planning.plan` made.
        out: directory; one that holds another policy's evaluation is refused.
        command: how to run this again, for the page.
        workers: processes; 1: this one; by default one per core where that is worth it.
        progress: show a bar.
        on_doubt: called at the end, with each sentence that casts doubt on the result.
        cluster: an engine that may be on other machines, in place of this one's processes.

    Returns:
        What ``panel.json`` holds; ``warnings`` lists the doubts.

    Raises:
        RunDirectoryError: for a directory that holds something else.
        SpawnError: where worker processes cannot be started, before anything is created.
        PanelError: if an evaluation fails; what was finished stays.
    """
    row, home, spec = existing.policy.policy_id, existing.home, as_there(spec, out)
    content = {**spec.to_json(), "policy": existing.policy.content_hash, "home": existing.told}
    learned_by = installed_versions(TRAINERS["sb3"])
    directory = RunDirectory(out, content, {**learned_by, **spec.engine_versions()})
    subjects = [
        Subject(existing.policy, spec.cells_of(home), home, home_known=home is not None),
        *(Subject(baseline_of(spec, name), spec.cells_of(None)) for name in spec.baselines),
    ]
    shared = cluster is not None and (cluster.remote or directory.storage.remote)
    elsewhere = cluster if shared else None
    if elsewhere is None:
        processes = _processes(workers, all_seconds(spec, subjects))
    else:
        processes = elsewhere.workers
    if processes:
        check_spawning(existing.policy, alone=True)
    with directory.opened():
        for name, source in existing.files.items():
            replace_file(directory.policies / row / name, source.read_bytes())
        directory.storage.keep("policies")
        if elsewhere is None:
            evaluate_all(spec, directory, subjects, "evaluate", processes, progress)
        else:
            evaluate_on(elsewhere, spec, directory, subjects, "evaluate", progress)
        panel = write_pages(
            partial(_write, existing, spec, directory, subjects, command, max(1, processes)),
            directory,
        )
        directory.finish_work()
    for doubt in panel.warnings:
        on_doubt(doubt)
    return panel


def _write(
    existing: Existing,
    spec: PanelSpec,
    directory: RunDirectory,
    subjects: Sequence[Subject],
    command: str,
    processes: int,
) -> Panel:
    """Reduce the records, and write the directory's page."""
    check_records(directory)
    layout, matrix = reduced(
        spec, directory, given_rows(spec, existing.policy.policy_id, existing.home)
    )
    return write_outputs(
        spec,
        directory,
        layout,
        matrix,
        [_told(existing, subject.policy) for subject in subjects],
        command=command,
        cost=cost_of(directory, (), processes),
        spec={**spec.to_json(), "home": existing.told},
        remark=given_remark(spec, layout, matrix),
        warnings=(
            *_unscaled(existing),
            *_homeless(existing),
            *_no_better(existing, spec, matrix),
            *_cannot_fail(spec, EvidenceStore(directory.evidence)),
        ),
    )


def _processes(workers: int | None, seconds: float) -> int:
    """Worker processes; 0: this one works."""
    if workers is None:
        return 0 if seconds < SHORT else cores()
    if workers < 1:
        raise ValueError(f"`workers` must be 1 or above, got {workers}")
    return 0 if workers == 1 else workers


def _told(existing: Existing, policy: Policy) -> PanelPolicy:
    """What the panel says of a policy; of a baseline no more than its name."""
    name = policy.policy_id
    if policy is not existing.policy:
        return PanelPolicy(id=name, seed=None, hash=None, file=None)
    kept = next(iter(existing.files), None)
    file = kept and f"policies/{name}/{kept}"
    return PanelPolicy(id=name, seed=existing.seed, hash=policy.content_hash, file=file)


def _unscaled(existing: Existing) -> list[str]:
    """Doubt where the observations that it learned from were of another scale."""
    if not existing.unscaled:
        return []
    remedy = "pass --obs-stats vecnormalize.pkl, also of one with norm_obs=False, which says so"
    if not existing.files:
        remedy = "load it with env=VecNormalize.load(path, venv)"
    return [
        f"{existing.policy.policy_id} was trained inside VecNormalize, which scales observations, "
        "and was judged without its statistics, so nothing here need be what it does with them; "
        f"{remedy}"
    ]


def _homeless(existing: Existing) -> list[str]:
    """What is not known where the home is not."""
    if existing.home is not None:
        return []
    return [
        f"the home of {existing.policy.policy_id} is unknown, so nothing is held against it and "
        f"no failure is put down to the discretization; {HOW_TO_STATE}"
    ]


def _no_better(existing: Existing, spec: PanelSpec, matrix: Matrix) -> list[str]:
    """Doubt where the policy is no better than random at home, or anywhere without a home."""
    home = home_cell(existing.home)
    row = existing.policy.policy_id
    cells = [cell.name for cell in spec.columns()] if home is None else [home]
    leads = {cell: _lead(matrix, row, cell) for cell in cells}
    if any(lead > 2.0 * error for lead, error in leads.values()):
        return []
    best = max(cells, key=lambda cell: leads[cell][0])
    own, chance = (matrix.values(name, best, "return")[0] for name in (row, "random"))
    compared = f"{own.mean():.1f} over {len(own)} episodes"
    if home is None:
        return [
            f"on no discretization is the policy shown to be better than random: it comes nearest "
            f"on {best}, with a return of {compared} where random's is {chance.mean():.1f}; "
            f"{_remedy(existing)}"
        ]
    better = "no better than" if leads[best][0] <= 0 else "not shown to be better than"
    return [
        f"on its home discretization ({home}) the policy's return {compared} is {better} "
        f"random's {chance.mean():.1f}; {_remedy(existing)}"
    ]


def _lead(matrix: Matrix, row: str, cell: str) -> tuple[float, float]:
    """By how much the policy's mean return exceeds random's, and the standard error of that."""
    own, chance = (matrix.values(name, cell, "return")[0] for name in (row, "random"))
    difference = own - chance
    error = float(difference.std(ddof=1)) / math.sqrt(len(difference)) if len(own) > 1 else 0.0
    return float(difference.mean()), error


def _remedy(existing: Existing) -> str:
    if existing.unscaled:
        return "the missing statistics would explain it"
    if not existing.files:
        return "does it take this environment's observations, and give its actions?"
    if getattr(existing.policy, "statistics", None) is not None:
        return "was it trained for long enough?"
    long = "" if existing.seed is None else "was it trained for long enough? "
    return f"{long}trained with VecNormalize? pass --obs-stats vecnormalize.pkl"


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
