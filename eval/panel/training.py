"""Training of a panel's policies: who is trained together, the trainer, and policies taken over."""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from integ_gym.evidence.labels import EpisodeContext
from integ_gym.support.errors import MissingPackageError
from integ_gym.support.executors import Cluster
from integ_gym.support.files import read_object, write_json
from integ_gym.support.optional import require
from integ_gym.train.config import TrainingConfig, TrainingEvidence
from integ_gym.train.fleet.worker import GIB_PER_WORKER, Workers, workers_of
from integ_gym.train.policy_files.card import card_hash
from integ_gym.train.policy_files.sidecar import TrainedPolicy

from .plan import stages
from .run_directory import MANIFEST, WORK, RunDirectory, RunDirectoryError, read_manifest
from .spec import PanelSpec
from .units import Unit, is_trained, trained_units, training_config, training_key

_CHUNKS = "together"
_DIVISION = "division.json"


def waiting_chunks(
    spec: PanelSpec, directory: RunDirectory, workers: Workers, memory_gib: float | None = None
) -> list[tuple[Unit, ...]]:
    """The training runs that are not finished, each with all that it is trained together with.

    Args:
        spec: the panel, or a stage of it.
        directory: held by the caller.
        workers: that the work is divided for, if it was not before.
        memory_gib: that they may take together.
    """
    units = {unit.policy: unit for unit in trained_units(spec)}
    waiting = {unit.policy for unit in units.values() if not is_trained(spec, directory, unit)}
    noted = _read_chunks(directory)
    chunks = [tuple(map(str, chunk)) for chunk in noted if set(chunk) <= set(units)]
    known = {policy for chunk in chunks for policy in chunk}
    for stage in stages(spec):
        new = [u for u in trained_units(stage) if u.policy in waiting and u.policy not in known]
        chunks += _divide_units(spec, new, workers, memory_gib)
        known.update(unit.policy for unit in new)
    if len(chunks) > len(noted):
        write_json(directory.path / WORK / _DIVISION, {_CHUNKS: chunks})
        directory.storage.send()
    return [tuple(units[p] for p in chunk) for chunk in chunks if waiting.intersection(chunk)]


def _read_chunks(directory: RunDirectory) -> list[Any]:
    """Who is trained together, as it was noted."""
    path = directory.path / WORK / _DIVISION
    return list(read_object(path, {_CHUNKS: list}, "remove it")[_CHUNKS]) if path.exists() else []


def _divide_units(
    spec: PanelSpec, units: Sequence[Unit], workers: Workers, memory_gib: float | None
) -> list[tuple[str, ...]]:
    if not units:
        return []
    if spec.trainer != "fleet":
        return [(unit.policy,) for unit in units]
    from integ_gym.train.fleet.planning import plan

    configs = [training_config(spec, unit) for unit in units]
    chunks = plan(configs, workers, memory_gib)  # type: ignore[arg-type]
    return [tuple(units[place].policy for place in chunk.places) for chunk in chunks]


_AGAIN = ".again"
"""Folder for what is trained once more, because something that it is trained with is not there."""


def check_training(spec: PanelSpec, workers: Workers, memory_gib: float | None = None) -> None:
    """Check that the trainer can train every policy of a panel.

    Args:
        spec: the panel.
        workers: of the fleet.
        memory_gib: that they may take together.

    Raises:
        ModuleNotFoundError: without the extra, with the command that installs it and another way.
        TypeError, ValueError: for a run that it cannot train.
    """
    configs: list[Any] = [training_config(spec, unit) for unit in trained_units(spec)]
    spec.algorithm.config.check_actions(spec.nominal.action_space)
    if spec.trainer != "fleet":
        require(*(("train",) if configs else ()))
        return
    try:
        require("fleet")
    except ModuleNotFoundError as error:
        raise MissingPackageError(
            f'{error}; or train with stable-baselines3: --trainer sb3, or `trainer = "sb3"` in '
            "the specification",
            name=error.name,
        ) from None
    from integ_gym.train.fleet.planning import plan

    plan(configs, workers, memory_gib)


def train_units(spec: PanelSpec, directory: RunDirectory, cluster: Cluster, progress: bool) -> None:
    """Train all policies that are not there yet, and mark each with its records as finished.

    Args:
        spec: the panel.
        directory: held by the caller.
        cluster: where.
        progress: show a bar.
    """
    chunks = waiting_chunks(spec, directory, workers_of(cluster), memory_of(spec, cluster))
    if not chunks:
        return
    units = [unit for chunk in chunks for unit in chunk]
    again = RunDirectory(directory.path / WORK / _AGAIN, spec.to_json())
    again.make_folders()
    places = [again if is_trained(spec, directory, u) else directory for u in units]
    for unit, place in zip(units, places, strict=True):
        place.discard_remains(unit.training)
        shutil.rmtree(place.policies / unit.policy, ignore_errors=True)
    directory.storage.send()  # what is no longer there
    options: dict[str, Any] = {"tensorboard": False}
    train: Any = spec.algorithm.train
    if spec.trainer == "fleet":
        from integ_gym.train.fleet.training import train_fleet as train

        ends = iter(range(len(units)))
        together = [tuple(next(ends) for _ in chunk) for chunk in chunks]
        options = {"memory_gib": spec.memory_gib, "together": together}
    train(
        [training_config(spec, unit) for unit in units],
        [place.policies / unit.policy for unit, place in zip(units, places, strict=True)],
        evidence=[_evidence(spec, p, u) for u, p in zip(units, places, strict=True)],
        progress=progress,
        on_trained=_make_marker(spec, units, places),
        executor=cluster,
        **options,
    )
    shutil.rmtree(again.path, ignore_errors=True)


def memory_of(spec: PanelSpec, cluster: Cluster) -> float | None:
    """What the processes that train may take together, GiB; None: a share of this machine's."""
    if spec.memory_gib is not None or not cluster.remote:
        return spec.memory_gib
    workers = workers_of(cluster)
    return GIB_PER_WORKER[workers.device] * workers.count


def preparation_of(spec: PanelSpec, cluster: Cluster) -> Callable[[int], None] | None:
    """What a worker elsewhere does first; it may train and evaluate in turn."""
    if not (spec.trainer == "fleet" and cluster.remote):
        return None
    from integ_gym.train.fleet.training import preparation

    return preparation(workers_of(cluster).device)


def _make_marker(
    spec: PanelSpec, units: Sequence[Unit], places: Sequence[RunDirectory]
) -> Callable[[int, TrainedPolicy], None]:
    """What marks a unit as finished, called with its place and what was trained."""
    start = time.time()

    def mark(number: int, trained: TrainedPolicy) -> None:
        unit, seconds = units[number], float(trained.card["wall_seconds"])
        hashes = {"policy": trained.content_hash, "card": card_hash(trained.card)}
        key = training_key(spec, unit)
        places[number].finish(unit.training, key, start, seconds, **hashes)
        places[number].storage.send()

    return mark


def _evidence(spec: PanelSpec, directory: RunDirectory, unit: Unit) -> TrainingEvidence:
    """Where the training episodes of a unit go, and what they are for."""
    assert unit.home is not None
    config: TrainingConfig = training_config(spec, unit)
    context = EpisodeContext(
        run_id=spec.name,
        cell=unit.training,
        phase="training",
        policy_id=unit.policy,
        training_discretization=unit.home.arguments(),
        training_seed=unit.seed,
        trace_every=config.trace_every,
        packages=directory.versions(),
    )
    return TrainingEvidence(directory.evidence, unit.training, context)


def finished_policies(path: Path, spec: PanelSpec) -> RunDirectory:
    """The directory of a panel whose policies another one would train alike.

    Args:
        path: directory of the panel that trained them.
        spec: the panel that wants them.

    Raises:
        RunDirectoryError: unless the directory has every policy of ``spec`` with its training
            evidence, trained by the same trainer with the same key.
    """
    manifest = path / MANIFEST
    if not manifest.exists():
        raise RunDirectoryError(
            f"{path} holds no panel; give --policies the directory of a finished one"
        )
    held = read_manifest(manifest)["specification"]
    wanted, trainer = spec.to_json()["trainer"], held.get("trainer")
    if trainer != wanted:
        raise RunDirectoryError(
            f"the policies in {path} come from trainer {_trainer_words(trainer)}, this panel's "
            f"from {_trainer_words(wanted)}; choose with --trainer, or train without --policies"
        )
    source = RunDirectory(path, held)
    for unit in trained_units(spec):
        marker = source.marker(unit.training)
        if marker is not None and marker.get("key") != training_key(spec, unit):
            raise RunDirectoryError(
                f"policy {unit.policy} in {source.path} was trained with other hyperparameters, on "
                "another environment or by another version; train without --policies"
            )
        if marker is None or not is_trained(spec, source, unit):
            raise RunDirectoryError(
                f"{source.path} has no finished policy {unit.policy}; give the directory of a "
                "finished panel with all rows and seeds of this one, or train without --policies"
            )
    return source


def copy_policies(source: RunDirectory, directory: RunDirectory, spec: PanelSpec) -> None:
    """Copy every policy that is not there yet, and the looks at it; its marker comes last.

    Args:
        source: what :func:`finished_policies` found.
        directory: held by the caller.
        spec: the panel that wants them.
    """
    missing = [unit for unit in trained_units(spec) if not is_trained(spec, directory, unit)]
    if missing:
        directory.inherit_looks(source)
        for unit in missing:
            directory.discard_remains(unit.training)
            directory.adopt_policy(source, unit.policy)
            directory.adopt(source, unit.training)
    directory.storage.send()


def _trainer_words(trainer: Any) -> str:
    if not isinstance(trainer, Mapping):
        return repr(trainer)
    packages = [f"{k} {v}" for k, v in trainer.items() if k != "name"]
    return " with ".join([repr(trainer.get("name")), *packages])
