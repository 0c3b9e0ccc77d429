"""A panel from its specification to its page."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path

from integ_gym.support.errors import InputError
from integ_gym.support.executors import Cluster, Resources, open_cluster
from integ_gym.support.files import display_path
from integ_gym.support.optional import require
from integ_gym.support.processes import check_spawning, cores
from integ_gym.support.storage import Place, Storage, open_storage
from integ_gym.train.fleet.worker import workers_of
from integ_gym.train.policy_files.sidecar import read_trained, readable_file

from .cells import SpecError
from .costs import check_cost
from .elsewhere import all_cells, make_interpreters
from .episodes import Subject
from .evaluate import evaluate_all, evaluated
from .outputs import Call, write_artefact
from .plan import stages, with_episode_parts
from .result import Panel
from .run_directory import MANIFEST, RunDirectory, read_manifest
from .spec import PanelSpec, read_spec
from .training import check_training, copy_policies, finished_policies, memory_of, train_units
from .units import PanelError, Unit, baseline_of, is_card_of, units_of


def check_spec(spec: PanelSpec, cluster: Cluster | None = None) -> None:
    """Check what only the trainer and the baselines know.

    Args:
        spec: the panel.
        cluster: where it runs; by default on this machine.

    Raises:
        SpecError: for unknown hyperparameters or baselines, or what the trainer cannot train.
        ModuleNotFoundError: if it needs an extra that is missing.
    """
    for name in ("env_id", "env_arguments", "seed"):
        if name in spec.training:
            raise SpecError(
                f"panel {spec.name!r}: `{name}` in `training` is set by the panel itself; use "
                "`env_id`, `environment` and `seeds`"
            )
    check_cost(spec)
    where = cluster or Cluster(cores())
    try:
        for name in spec.baselines:
            baseline_of(spec, name)
        check_training(spec, workers_of(where), memory_of(spec, where))
    except (TypeError, ValueError) as error:
        raise SpecError(f"panel {spec.name!r}: {error}") from error


def as_there(spec: PanelSpec, storage: Storage) -> PanelSpec:
    """The same panel with its episodes in the parts in which a directory has them; see `parts`.

    Args:
        spec: the panel.
        storage: its directory, or where else it is kept.

    Raises:
        RunDirectoryError: if what the directory says of its run is damaged.
    """
    storage.fetch(MANIFEST)
    manifest = storage.path / MANIFEST
    if not manifest.exists():
        return spec
    return with_episode_parts(spec, read_manifest(manifest)["specification"])


@contextmanager
def opened(
    spec: PanelSpec,
    out: Storage,
    cluster: Cluster | None = None,
    policies: Path | None = None,
    progress: bool = False,
) -> Iterator[RunDirectory]:
    """The directory of a panel that can be run, held; see `complete`.

    Args:
        spec: the panel.
        out: its directory, or where else it is kept.
        cluster: where it runs; by default on this machine.
        policies: directory of a finished panel whose policies are taken instead of training.
        progress: say which interpreters are made.

    Raises:
        SpecError, RunDirectoryError, InterpreterError: for what cannot be run, before anything is
            written.
    """
    check_spec(spec, cluster)
    baselines = [baseline_of(spec, name) for name in spec.baselines]
    make_interpreters(spec, all_cells(spec), baselines, progress)
    directory = RunDirectory(out, spec.to_json(), spec.engine_versions())
    source = None if policies is None else finished_policies(policies, spec)
    with directory.opened():
        if source is not None:
            copy_policies(source, directory, spec)
        yield directory


def complete(
    spec: PanelSpec,
    directory: RunDirectory,
    label: str,
    cluster: Cluster,
    progress: bool = True,
) -> bool:
    """Train and evaluate everything that is not finished yet; whether there was anything.

    Args:
        spec: the panel, or a stage of it.
        directory: held by the caller.
        label: of the bar.
        cluster: where.
        progress: show a bar with the remaining time.

    Raises:
        PanelError: if a unit of work fails; what was finished stays.
    """
    before = evaluated(directory)
    train_units(spec, directory, cluster, progress)
    subjects = [subject_of(spec, directory, unit) for unit in units_of(spec)]
    evaluate_all(spec, directory, subjects, label, cluster, progress)
    return evaluated(directory) != before


def subject_of(spec: PanelSpec, directory: RunDirectory, unit: Unit) -> Subject:
    """The policy of a unit, read from its file or built."""
    cells = spec.cells_of(unit.home)
    if unit.home is None:
        return Subject(baseline_of(spec, unit.row), cells, starts=spec.start_sets[0])
    policy, card = read_trained(readable_file(directory.policies / unit.policy))
    marker = directory.marker(unit.training)
    if marker is None or not is_card_of(card, marker):
        raise PanelError(
            f"policies/{unit.policy} or its side-car was changed after this panel trained it; "
            "restore it, or give another directory with --out"
        )
    own = replace(policy, policy_id=unit.policy)
    return Subject(own, cells, unit.home, unit.seed, unit.seed or 0)


def run_panel(
    spec: PanelSpec | str | os.PathLike[str],
    out: str | os.PathLike[str],
    *,
    workers: int | None = None,
    progress: bool = True,
    policies: str | os.PathLike[str] | None = None,
    command: str = "integ_gym.run_panel",
    executor: str = "local",
    address: str | None = None,
    resources: Resources | None = None,
    staged: bool = True,
) -> Panel:
    """Train and evaluate all that is not finished yet, and write the panel's directory.

    A first page comes after a few training seeds, marked as not decided; see :func:`stages`.

    Args:
        spec: of the panel: as it is, the name of a built-in one, or the path of a TOML file.
        out: its directory, or ``s3://…``, ``gs://…``, ``az://…``; see docs/how-to/clusters.md.
        workers: processes; by default one per core.
        progress: show a bar with the remaining time on stderr.
        policies: directory of a finished panel whose policies are taken instead of training.
        command: how to run this again, for the page.
        executor: what runs the processes: ``"local"``, ``"ray"``, ``"dask"``, ``"slurm"``, or
            ``"module:function"`` for a `concurrent.futures.Executor`; see docs/how-to/clusters.md.
        address: of a running cluster of Ray or Dask; by default one is started on this machine.
        resources: of each worker of such an engine.
        staged: whether pages are written before the last seed is there.

    Returns:
        What ``panel.json`` holds.

    Raises:
        SpecError, RunDirectoryError: for what cannot be run, before anything is written.
        SpawnError: where worker processes cannot be started, before anything is written.
        PanelError, TrainingError: if a unit of work fails; what was finished stays.
        ModuleNotFoundError: if an extra is missing, with the command that installs it.
    """
    require("report", "evidence")
    check_spawning()
    asked = spec if isinstance(spec, PanelSpec) else read_spec(os.fspath(spec))
    taken = None if policies is None else Path(policies)
    wanted = resources_for(resources, workers, asked.memory_gib)
    with ExitStack() as stack:
        cluster = stack.enter_context(open_cluster(executor, address, wanted))
        place = stack.enter_context(open_storage(out))
        given = as_there(asked, place)
        directory = stack.enter_context(opened(given, place, cluster, taken, progress))
        called = Call(command, cluster.workers, display_path(str(directory.storage)))
        before = directory.markers("")
        every = stages(given) if staged else (given,)
        for number, stage in enumerate(every, 1):
            label = f"panel {given.name}" + (f" {number}/{len(every)}" if len(every) > 1 else "")
            new = complete(stage, directory, label, cluster, progress)
            if new and stage is not given:
                write_artefact(stage, directory, label, called, progress, of=given)
        if progress and directory.markers("") == before:
            print("Complete: nothing to train or evaluate.", file=sys.stderr)
        panel = write_artefact(given, directory, label, called, progress)
        directory.finish_work()
        return panel


@contextmanager
def rewriting(place: Place) -> Iterator[Path]:
    """A run's folder, or a copy of it whose changed pages are sent back with the block's end.

    Raises:
        RunDirectoryError: if a driver works there.
        ValueError: for a name of no place.
    """
    with open_storage(place) as storage:
        if not storage.remote:
            yield storage.path
            return
        with RunDirectory(storage, {}).locked():
            storage.fetch()
            yield storage.path
            storage.send()


def resources_for(
    given: Resources | None, workers: int | None, memory_gib: float | None
) -> Resources:
    """What is asked for, each thing in one place."""
    for name, own in (("workers", workers), ("memory_gib", memory_gib)):
        asked = getattr(given, name, None)
        if asked is not None and asked != own:
            place = "`workers`" if name == "workers" else "the specification"
            raise InputError(f"`{name}` of `resources` is said by {place}; leave it out there")
    return replace(given or Resources(), workers=workers, memory_gib=memory_gib)
