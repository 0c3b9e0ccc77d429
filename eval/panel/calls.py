"""A panel from its specification to its page, and the same for a policy: one call each."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from integ_gym.support.errors import InputError, InputTypeError
from integ_gym.support.executors import Resources, open_cluster
from integ_gym.support.optional import require
from integ_gym.support.processes import check_spawning
from integ_gym.support.storage import Place, open_storage
from integ_gym.support.terminal import say
from integ_gym.train.policy_files.sidecar import Stated

from .existing.evaluate import evaluate_existing
from .existing.given import given_policy, is_reference
from .existing.planning import plan
from .existing.policy import read_existing
from .outputs import phases, write_artefact
from .plan import stages
from .result import Panel
from .running.panel import as_there, complete, opened
from .running.run_directory import RunDirectory
from .spec import BUILT_IN, PanelSpec, built_in_spec, read_spec


def specified(spec: PanelSpec | str | os.PathLike[str]) -> PanelSpec:
    """A specification as it is, by the name of a built-in one, or from a TOML file.

    Raises:
        SpecError: for a file that cannot be read or says what cannot be.
    """
    if isinstance(spec, PanelSpec):
        return spec
    return built_in_spec(str(spec)) if spec in BUILT_IN else read_spec(Path(spec))


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
        spec: of the panel; see :func:`specified`.
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
    asked, taken = specified(spec), None if policies is None else Path(policies)
    wanted = _resources(resources, workers, asked.memory_gib)
    with ExitStack() as stack:
        cluster = stack.enter_context(open_cluster(executor, address, wanted))
        place = stack.enter_context(open_storage(out))
        given = as_there(asked, place)
        directory = stack.enter_context(opened(given, place, cluster, taken))
        write = partial(
            _write, directory, command=command, workers=cluster.workers, progress=progress
        )
        before = directory.markers("")
        every = stages(given) if staged else (given,)
        for number, stage in enumerate(every, 1):
            label = f"panel {given.name}" + (f" {number}/{len(every)}" if len(every) > 1 else "")
            new = complete(stage, directory, label, cluster, progress)
            if new and stage is not given:
                write(stage, label, of=given)
        if progress and directory.markers("") == before:
            print("Complete: nothing to train or evaluate.", file=sys.stderr)
        panel = write(given, label)
        directory.finish_work()
        return panel


def _write(
    directory: RunDirectory,
    spec: PanelSpec,
    label: str,
    of: PanelSpec | None = None,
    *,
    command: str,
    workers: int,
    progress: bool,
) -> Panel:
    """Write a panel's page, or that of a stage of it, while a bar tells what is done."""
    with phases(label, progress) as begin:
        panel = write_artefact(spec, directory, command, workers, of=of, begin=begin)
    directory.storage.send()
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


def _resources(given: Resources | None, workers: int | None, memory_gib: float | None) -> Resources:
    """What is asked for, each thing in one place."""
    for name, own in (("workers", workers), ("memory_gib", memory_gib)):
        asked = getattr(given, name, None)
        if asked is not None and asked != own:
            place = "`workers`" if name == "workers" else "the specification"
            raise InputError(f"`{name}` of `resources` is said by {place}; leave it out there")
    return replace(given or Resources(), workers=workers, memory_gib=memory_gib)


def tell_doubt(doubt: str) -> None:
    """Say a sentence that casts doubt on a result on stderr."""
    say(f"warning: {doubt}", sys.stderr)


def evaluate(
    policy: Any,
    env_id: str,
    out: str | os.PathLike[str],
    *,
    home: Stated = None,
    integrators: Sequence[str] = (),
    dts: Sequence[float] = (),
    episodes: int = 50,
    environment: Mapping[str, Any] | None = None,
    obs_stats: str | os.PathLike[str] | None = None,
    own_code: bool = False,
    workers: int | None = None,
    progress: bool = True,
    on_home: Callable[[str], None] = lambda line: None,
    on_doubt: Callable[[str], None] = tell_doubt,
    command: str = "integ_gym.evaluate",
    executor: str = "local",
    address: str | None = None,
    resources: Resources | None = None,
) -> Panel:
    """Judge a policy that exists already over many discretizations: a panel without training.

    Args:
        policy: a policy's file, and beside it the side-car if there is one; a function from one
            observation to one action; anything with ``predict``, such as a model of
            stable-baselines3; or ``"module:function"``.
        env_id: one of integ-gym's environments, or a MuJoCo task of Gymnasium's.
        out: directory, or a place in an object store; one that holds another policy's evaluation
            is refused.
        home: what it was trained on: ``"integrator=…,dt=…,control_period=…"``, the same as a
            mapping or a `Discretization`, or ``"stock"`` for Gymnasium's own environment. By
            default what the side-car says; without one it is unknown, and null in evidence.
        integrators: to judge on; by default all.
        dts: integration steps, s; by default the coarsest, half and a quarter of it.
        episodes: paired starts.
        environment: constructor arguments, without the discretization.
        obs_stats: VecNormalize's statistics, as its ``vecnormalize.pkl`` or as JSON.
        own_code: whether classes that the side-car names as ``"module:Class"`` may be loaded.
        workers: processes; 1: this one; by default one per core where that is worth it.
        progress: show a bar on stderr.
        on_home: told what is taken as home and why, before anything is run.
        on_doubt: told each sentence that casts doubt on the result; by default stderr is.
        command: how to run this again, for the page.
        executor: what runs the processes; see :func:`run_panel`.
        address: of a running cluster.
        resources: of each worker of an engine.

    Returns:
        What ``panel.json`` holds; ``warnings`` lists the doubts.

    Raises:
        PolicyFileError, TypeError, ValueError: for a policy that cannot be read or does not fit, a
            home that cannot be, or a cell that cannot be made.
        RunDirectoryError: for a directory that holds something else.
        SpawnError: where worker processes cannot be started, before anything is created.
        PanelError: if an evaluation fails; what was finished stays.
        ModuleNotFoundError: if an extra is missing, with the command that installs it.
    """
    require("report", "evidence")
    given = environment or {}
    if isinstance(policy, os.PathLike) and not Path(policy).exists():
        policy = os.fspath(policy)
    if is_reference(policy) or not isinstance(policy, str | os.PathLike):
        if obs_stats is not None:
            raise InputError(
                "statistics of observations are given for a policy's file; a model carries its own "
                "VecNormalize, and a function normalizes for itself"
            )
        if own_code:
            raise InputError(
                "own_code lets a side-car name classes, and a policy that is no file has none; "
                "leave it out"
            )
        existing = given_policy(policy, env_id, given, home)
    else:
        if not isinstance(obs_stats, str | os.PathLike | None):
            raise InputTypeError(
                "obs_stats must be a file, which the run keeps; save its numbers as JSON, or with "
                "integ_gym.write_sidecar(..., obs_stats=...)"
            )
        statistics = None if obs_stats is None else Path(obs_stats)
        existing = read_existing(Path(policy), env_id, given, statistics, own_code, home)
    spec = plan(existing, env_id, integrators, dts, episodes)
    on_home(str(existing.provenance))
    asked = _resources(resources, workers, None)
    with open_cluster(executor, address, asked) as cluster, open_storage(out) as place:
        return evaluate_existing(
            existing,
            spec,
            place,
            command,
            workers=workers,
            progress=progress,
            on_doubt=on_doubt,
            cluster=cluster,
        )
