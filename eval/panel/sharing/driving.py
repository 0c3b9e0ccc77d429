"""A panel driven on an engine of others: each unit a task, and the shared directory the only truth.

A task seizes its unit from whoever held it: the engine runs it again only where it takes the one
before for dead. Should that one live all the same, it can no longer commit.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from integ_gym.support import Claims, Cluster, FolderFiles
from integ_gym.train import preparation, training_bar, workers_of

from ..running import (
    DRIVEN,
    Desk,
    RunDirectory,
    Subject,
    Work,
    evaluated,
    evaluation_seconds,
    memory_of,
    not_evaluated,
    panel_bar,
    subject_of,
    training_config,
    units_of,
    working_on,
)
from ..specification import PanelSpec
from . import planning
from .shared_unit import SharedUnit, do_and_commit

Given = Mapping[SharedUnit, Sequence[Subject] | None]
"""Units, with the policies of those that evaluate others than the run's own."""


def complete_on(
    cluster: Cluster, spec: PanelSpec, directory: RunDirectory, *, progress: bool = True
) -> bool:
    """Train and evaluate everything that is not finished yet; whether there was anything.

    Args:
        cluster: the engine.
        spec: the panel, or a stage of it.
        directory: held by the caller, and seen by all workers under the same path.
        progress: show bars.

    Raises:
        PanelError: if a unit of work fails; what was finished stays.
    """
    before = evaluated(directory)
    _train_on(cluster, spec, directory, progress)
    subjects = [subject_of(spec, directory, unit) for unit in units_of(spec)]
    _evaluate(cluster, spec, directory, subjects, f"panel {spec.name}", progress, own=True)
    return evaluated(directory) != before


def evaluate_on(
    cluster: Cluster,
    spec: PanelSpec,
    directory: RunDirectory,
    subjects: Sequence[Subject],
    label: str,
    progress: bool,
) -> None:
    """Evaluate all subjects that have not been; see :func:`complete_on`."""
    _evaluate(cluster, spec, directory, subjects, label, progress, own=False)


def _train_on(cluster: Cluster, spec: PanelSpec, directory: RunDirectory, progress: bool) -> None:
    workers = workers_of(cluster)
    units = planning.training(spec, directory, workers, memory_of(spec, workers))
    if not units:
        return
    steps = {u.policy: training_config(spec, u).rounded_steps for u in units_of(spec) if u.home}
    policies = [policy for unit in units for policy in unit.policies]
    bar = training_bar(sum(steps[policy] for policy in policies), len(policies), progress)
    with working_on(cluster, bar, _prepare(cluster, spec)) as work:
        _do_all(directory, work, "training", dict.fromkeys(units))


def _evaluate(
    cluster: Cluster,
    spec: PanelSpec,
    directory: RunDirectory,
    subjects: Sequence[Subject],
    label: str,
    progress: bool,
    own: bool,
) -> None:
    seconds = evaluation_seconds(spec, subjects)
    waiting = not_evaluated(spec, directory, subjects)
    bar = panel_bar(label, seconds, progress)
    with working_on(cluster, bar, _prepare(cluster, spec)) as work:
        work.skip(seconds - evaluation_seconds(spec, waiting))
        cells = planning.trying(spec, directory)
        _do_all(directory, work, "trying what can be done", dict.fromkeys(cells))
        batches = planning.batches(spec, directory, subjects, cluster.workers)
        _do_all(directory, work, "evaluating", {unit: None if own else b for unit, b in batches})


def _prepare(cluster: Cluster, spec: PanelSpec) -> Callable[[int], None] | None:
    """What every process of the engine does first; the same for all that it does of a panel."""
    return preparation(workers_of(cluster).device) if spec.fleet else None


def _do_all(directory: RunDirectory, work: Work, phase: str, units: Given) -> None:
    """Have units done until all are; one that was taken over by another task is asked for again."""
    Desk(directory.path, DRIVEN).open()
    waiting = dict(units)
    while waiting:
        run = str(directory.path.resolve())
        tasks: dict[str, tuple[Any, ...]] = {
            unit.name: (run, unit, given) for unit, given in waiting.items()
        }
        done = work.do(phase, do_seized, tasks)
        waiting = {u: g for (u, g), there in zip(waiting.items(), done, strict=True) if not there}


def do_seized(run: str, unit: SharedUnit, subjects: Sequence[Subject] | None) -> bool:
    """A task: do a unit, whoever holds it; False if another task took it over meanwhile."""
    desk = Desk(Path(run), DRIVEN)
    files = FolderFiles(desk.claims)
    claim = Claims(files, [unit.name], owner=str(os.getpid())).seize(unit.name)
    return do_and_commit(desk, claim, unit, subjects)
