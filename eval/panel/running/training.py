"""Training of a panel's policies, by the trainer that it names."""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable, Sequence
from typing import Any

from integ_gym.evidence.labels import EpisodeContext
from integ_gym.support.errors import MissingPackageError
from integ_gym.support.executors import Cluster
from integ_gym.support.optional import require
from integ_gym.train.config import TrainingConfig, TrainingEvidence
from integ_gym.train.fleet.worker import GIB_PER_WORKER, Workers, workers_of
from integ_gym.train.policy_files.card import card_hash
from integ_gym.train.policy_files.sidecar import TrainedPolicy

from ..spec import PanelSpec
from .division import waiting_chunks
from .run_directory import WORK, RunDirectory
from .units import Unit, is_there, trained_units, training_config, training_key

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
    if not spec.fleet:
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
    places = [again if is_there(spec, directory, u) else directory for u in units]
    for unit, place in zip(units, places, strict=True):
        place.discard_remains(unit.training)
        shutil.rmtree(place.policies / unit.policy, ignore_errors=True)
    directory.storage.send()  # what is no longer there
    options: dict[str, Any] = {"tensorboard": False}
    train: Any = spec.algorithm.train
    if spec.fleet:
        from integ_gym.train.fleet.training import train_fleet as train

        ends = iter(range(len(units)))
        together = [tuple(next(ends) for _ in chunk) for chunk in chunks]
        options = {"memory_gib": spec.memory_gib, "together": together}
    train(
        [training_config(spec, unit) for unit in units],
        [place.policies / unit.policy for unit, place in zip(units, places, strict=True)],
        evidence=[_evidence(spec, p, u) for u, p in zip(units, places, strict=True)],
        progress=progress,
        on_trained=_marking(spec, units, places),
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
    if not (spec.fleet and cluster.remote):
        return None
    from integ_gym.train.fleet.training import preparation

    return preparation(workers_of(cluster).device)


def _marking(
    spec: PanelSpec, units: Sequence[Unit], places: Sequence[RunDirectory]
) -> Callable[[int, TrainedPolicy], None]:
    """What marks a unit as finished, told its place and what was trained."""
    start = time.time()

    def mark(number: int, trained: TrainedPolicy) -> None:
        unit, seconds = units[number], float(trained.card["wall_seconds"])
        hashes = {"policy": trained.content_hash, "card": card_hash(trained.card)}
        key = training_key(training_config(spec, unit))
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
