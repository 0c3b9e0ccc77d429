"""The evaluation run, and its directory written."""

from __future__ import annotations

import sys
from collections.abc import Callable

from integ_gym.support.errors import InputError
from integ_gym.support.executors import Cluster
from integ_gym.support.files import replace_file
from integ_gym.support.optional import installed_versions
from integ_gym.support.processes import check_spawning, cores
from integ_gym.support.storage import Storage

from ..checking.sample import check_records
from ..outputs import (
    CHECKING,
    JUDGING,
    Begin,
    call_of,
    phases,
    write_outputs,
)
from ..result import Panel
from ..running.evaluation.subjects import Subject
from ..running.evaluation.units import all_seconds, evaluate_all
from ..running.panel import as_there
from ..running.run_directory import GIVEN, RunDirectory, Seen
from ..running.units import baseline_of
from ..spec import TRAINERS, PanelSpec
from .facts import facts_of, given_panel
from .policy import Existing

SHORT = 10.0
"""Expected work that is not worth starting worker processes for, s."""


def evaluate_existing(
    existing: Existing,
    spec: PanelSpec,
    out: Storage,
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
        out: its directory, or where else it is kept; one that holds another policy's evaluation
            is refused.
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
    if cluster is None or not cluster.remote:
        cluster = Cluster(_processes(workers, all_seconds(spec, subjects)))
    if cluster.workers:
        check_spawning(existing.policy, alone=True)
    with directory.opened():
        for name, source in existing.files.items():
            replace_file(directory.policies / row / name, source.read_bytes())
        before = directory.markers("")
        evaluate_all(spec, directory, subjects, "evaluate", cluster, progress)
        if progress and directory.markers("") == before:
            print("Complete: nothing to evaluate.", file=sys.stderr)
        with phases("evaluate", progress) as begin:
            count = max(1, cluster.workers)
            panel = _write(existing, spec, directory, command, count, begin)
        directory.finish_work()
    for doubt in panel.warnings:
        on_doubt(panel.said(doubt))
    return panel


def _write(
    existing: Existing,
    spec: PanelSpec,
    directory: RunDirectory,
    command: str,
    processes: int,
    begin: Begin,
) -> Panel:
    """Reduce the records, and write the directory's page."""
    begin(CHECKING)
    check_records(directory)
    begin(JUDGING)
    directory.note(**{GIVEN: facts_of(existing)})
    directory.record_look(Seen(1, spec.episodes, 0))
    called = call_of(directory, command, processes)
    return write_outputs(directory, given_panel(spec, directory, called), called, begin)


def _processes(workers: int | None, seconds: float) -> int:
    """Worker processes; 0: this one works."""
    if workers is None:
        return 0 if seconds < SHORT else cores()
    if workers < 1:
        raise InputError(f"`workers` must be 1 or above, got {workers}")
    return 0 if workers == 1 else workers
