"""Training of a panel's policies, by the trainer that it names."""

from __future__ import annotations

import shutil
import time
from typing import Any

from integ_gym.evidence import EpisodeContext
from integ_gym.support import require
from integ_gym.train import TrainedPolicy, TrainingConfig, TrainingEvidence, card_hash

from ..specification import PanelSpec
from .run_directory import RunDirectory, package_versions
from .units import Unit, is_trained, trained_units, training_config, training_key


def check_training(spec: PanelSpec, workers: int | None) -> None:
    """Check that the trainer can train every policy of a panel.

    Args:
        spec: the panel.
        workers: processes, if so many are requested.

    Raises:
        ModuleNotFoundError: without the extra, with the command that installs it and another way.
        TypeError, ValueError: for a run that it cannot train.
    """
    configs: list[Any] = [training_config(spec, unit) for unit in trained_units(spec)]
    spec.algorithm.config.check_actions(spec.nominal.action_space)
    if not spec.fleet:
        return
    try:
        require("fleet")
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(
            f'{error}; or train with stable-baselines3: --trainer sb3, or `trainer = "sb3"` in '
            "the specification",
            name=error.name,
        ) from None
    from integ_gym.train import fleet_workers, plan

    plan(configs, fleet_workers(workers), spec.memory_gib)


def train_units(
    spec: PanelSpec,
    directory: RunDirectory,
    workers: int | None,
    progress: bool,
) -> None:
    """Train all policies that are not there yet, and mark each with its records as finished.

    Args:
        spec: the panel.
        directory: held by the caller.
        workers: processes, if so many are requested.
        progress: show a bar.
    """
    configs = {unit: training_config(spec, unit) for unit in trained_units(spec)}
    keys = {unit: training_key(config) for unit, config in configs.items()}
    waiting = [unit for unit, key in keys.items() if not is_trained(directory, unit, key)]
    if not waiting:
        return
    folders = [directory.policies / unit.policy for unit in waiting]
    for unit, folder in zip(waiting, folders, strict=True):
        directory.discard_remains(unit.training)
        shutil.rmtree(folder, ignore_errors=True)
    start = time.time()

    def mark(place: int, trained: TrainedPolicy) -> None:
        unit, seconds = waiting[place], float(trained.card["wall_seconds"])
        hashes = {"policy": trained.content_hash, "card": card_hash(trained.card)}
        directory.finish(unit.training, keys[unit], start, seconds, **hashes)

    train, options = _trainer(spec)
    train(
        [configs[unit] for unit in waiting],
        folders,
        evidence=[_evidence(spec, directory, unit, configs[unit]) for unit in waiting],
        progress=progress,
        workers=workers,
        on_trained=mark,
        **options,
    )


def _trainer(spec: PanelSpec) -> tuple[Any, dict[str, Any]]:
    """The trainer, and what it alone is told."""
    if not spec.fleet:
        return spec.algorithm.train, {"tensorboard": False}
    from integ_gym.train import train_fleet

    return train_fleet, {"memory_gib": spec.memory_gib}


def _evidence(
    spec: PanelSpec, directory: RunDirectory, unit: Unit, config: TrainingConfig
) -> TrainingEvidence:
    """Where the training episodes of a unit go, and what they are for."""
    assert unit.home is not None
    context = EpisodeContext(
        run_id=spec.name,
        cell=unit.training,
        phase="training",
        policy_id=unit.policy,
        training_discretization=unit.home.arguments(),
        training_seed=unit.seed,
        trace_every=config.trace_every,
        packages=package_versions(),
    )
    return TrainingEvidence(directory.evidence, unit.training, context)
