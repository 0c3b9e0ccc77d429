"""A panel driven on an engine of others: each unit a task, and the shared directory the only truth.

A task seizes its unit from whoever held it: the engine runs it again only where it takes the one
before for dead. Should that one live all the same, it can no longer commit.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeVar

from integ_gym.support.sharing.claims import Claim, Claims
from integ_gym.support.sharing.clusters import Cluster
from integ_gym.support.sharing.folder_files import Gone
from integ_gym.support.storing.bucket import BucketStorage
from integ_gym.support.storing.places import Place, named_place, stored
from integ_gym.support.storing.storage import FolderStorage, Storage
from integ_gym.train.fleet.worker import Workers, fleet_workers, workers_of
from integ_gym.train.running.side_by_side import training_bar

from ..running.division import memory_of, noted_division
from ..running.evaluation.achievability import TRYING
from ..running.evaluation.subjects import Subject
from ..running.evaluation.units import evaluated, expected_seconds, not_evaluated
from ..running.panel import subject_of
from ..running.run_directory import RunDirectory
from ..running.staging import Desk
from ..running.units import training_config, units_of
from ..running.work import (
    PanelError,
    Work,
    panel_bar,
    working_on,
)
from ..specification.panel_spec import PanelSpec
from . import planning
from .shared_unit import SharedUnit, commit, do_and_commit

Written = TypeVar("Written")

PAGES = "pages"
"""Unit of all that is made of a run's records."""

Given = Mapping[SharedUnit, Sequence[Subject] | None]
"""Units, with the policies of those that evaluate others than the run's own."""


def complete_on(
    cluster: Cluster,
    spec: PanelSpec,
    directory: RunDirectory,
    label: str,
    *,
    progress: bool = True,
) -> bool:
    """Train and evaluate everything that is not finished yet; whether there was anything.

    Args:
        cluster: the engine.
        spec: the panel, or a stage of it.
        directory: held by the caller, and seen by all workers under the same path.
        label: of the bar.
        progress: show bars.

    Raises:
        PanelError: if a unit of work fails; what was finished stays.
    """
    before = evaluated(directory)
    _train_on(cluster, spec, directory, progress)
    subjects = [subject_of(spec, directory, unit) for unit in units_of(spec)]
    _evaluate(cluster, spec, directory, subjects, label, progress, own=True)
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
    workers = processes(cluster)
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
    waiting = [(part, not_evaluated(part, directory, subjects)) for part in spec.parts()]
    cells = planning.trying(spec, directory)
    if not cells and not any(left for _, left in waiting):
        directory.storage.drop_missing()
        return
    seconds, left = expected_seconds(spec, directory, subjects, waiting)
    bar = panel_bar(label, seconds, progress)
    with working_on(cluster, bar, _prepare(cluster, spec)) as work:
        work.skip(seconds - left)
        _do_all(directory, work, TRYING, dict.fromkeys(cells))
        for part in spec.parts():
            batches = planning.batches(part, directory, subjects, cluster.workers)
            given = {unit: None if own else batch for unit, batch in batches}
            _do_all(directory, work, "evaluating", given)


def _prepare(cluster: Cluster, spec: PanelSpec) -> Callable[[int], None] | None:
    """What every process of the engine does first; the same for all that it does of a panel."""
    if not spec.fleet:
        return None
    from integ_gym.train.fleet.training import preparation

    return preparation(processes(cluster).device)


def processes(cluster: Cluster) -> Workers:
    """The processes of an engine, or of this machine."""
    return workers_of(cluster) if cluster.remote else fleet_workers(cluster.workers)


def _do_all(directory: RunDirectory, work: Work, phase: str, units: Given) -> None:
    """Have units done until all are; one that was taken over by another task is asked for again.

    Raises:
        PanelError: if a unit fails, or another command took the run over.
    """
    directory.storage.drop_missing()
    if not units:
        return
    desk, waiting = directory.desk, dict(units)
    desk.open()
    run = str(named_place(str(directory.storage)) if desk.run.remote else desk.run.path.resolve())
    with in_time(directory):
        told = [unit.plain() for unit in units]
        plan = desk.add_plan(told, noted_division(directory))
        while waiting:
            tasks: dict[str, tuple[Any, ...]] = {
                unit.name: (run, desk.name, plan, unit, given) for unit, given in waiting.items()
            }
            there = work.do(phase, do_seized, tasks)
            waiting = {u: g for (u, g), x in zip(waiting.items(), there, strict=True) if not x}
    directory.storage.fetch()


@contextmanager
def in_time(directory: RunDirectory) -> Iterator[None]:
    """What is only done as long as nobody else has taken the run over.

    Raises:
        PanelError: if somebody has.
    """
    try:
        yield
    except (Gone, PanelError) as error:
        if not isinstance(error, Gone) and not isinstance(error.__cause__, Gone):
            raise
        raise PanelError(
            f"another process took the run in {directory.storage} over, because this one had been "
            "silent for too long; what was finished is kept"
        ) from None


def do_seized(
    run: str, desk: str, plan: str, unit: SharedUnit, subjects: Sequence[Subject] | None
) -> bool:
    """A task: do a unit, whoever holds it; False if another task took it over meanwhile.

    Args:
        run: the run's directory, or where else it is kept.
        desk: where it is claimed.
        plan: that it is of.
        unit: the unit.
        subjects: the policies that are evaluated, where the run's own are not.

    Raises:
        Gone: if another command took the run over.
    """
    own = Desk(_storage(run), desk)
    claims = Claims(own.claims_of(plan), [unit.name], owner=str(os.getpid()))
    return do_and_commit(own, claims.seize(unit.name), unit, subjects)


@lru_cache(maxsize=1)
def _storage(run: str) -> Storage:
    """Where a run is kept; a copy that is worked on goes with the process."""
    place = named_place(run)
    return FolderStorage(place) if isinstance(place, Path) else BucketStorage(place)


def write_pages(write: Callable[[], Written], directory: RunDirectory) -> Written:
    """Write a panel's page and what it rests on, and have it in place by one decision.

    Args:
        write: writes them into the run's folder, or its copy.
        directory: of the run, which this process alone drives.

    Raises:
        PanelError: if another command took the run over.
    """
    panel = write()
    if directory.storage.remote:
        with in_time(directory):
            claims = directory.desk.claims_of(directory.desk.add_plan([{"name": PAGES}]))
            commit_pages(directory, Claims(claims, [PAGES]).seize(PAGES))
    return panel


@contextmanager
def rewriting(place: Place) -> Iterator[Path]:
    """A run's folder, or a copy of it whose changed pages are put in place with the block's end.

    Raises:
        RunDirectoryError: if somebody works there.
        ValueError: for a name of no place.
    """
    with stored(place) as storage:
        if not storage.remote:
            yield storage.path
            return
        directory = RunDirectory(storage, {})
        with directory.kept():
            storage.fetch()
            yield storage.path
            write_pages(lambda: None, directory)
            directory.finish_work()


def commit_pages(directory: RunDirectory, claim: Claim) -> bool:
    """Put what was written into a copy of a run in place; False if another did."""
    directory.desk.stage_pages(claim)
    done = commit(directory.desk, claim)
    if done:
        directory.storage.drop_missing()
    return done
