"""Training of a panel's policies by the fleet trainer."""

from __future__ import annotations

import shutil
import time
from collections.abc import Sequence
from functools import partial

from integ_gym.envs.extras import require
from integ_gym.eval.run_directory import RunDirectory
from integ_gym.eval.spec import PanelSpec
from integ_gym.eval.units import (
    Unit,
    is_trained,
    training_config,
    training_context,
    training_key,
    units_of,
)
from integ_gym.train.sidecar import TrainedPolicy


def check_fleet(spec: PanelSpec, workers: int | None) -> None:
    """Check that the fleet can train every policy of a panel.

    Args:
        spec: the panel.
        workers: processes, if so many are requested.

    Raises:
        ModuleNotFoundError: without the extra, with the command that installs it and another way.
        TypeError, ValueError: for a run that it cannot train.
    """
    try:
        require("fleet")
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(
            f'{error}; or train with stable-baselines3: --trainer sb3, or `trainer = "sb3"` in '
            "the specification",
            name=error.name,
        ) from None
    from integ_gym.train.fleet_plan import plan
    from integ_gym.train.fleet_worker import fleet_workers

    configs = [training_config(spec, unit) for unit in _trained(units_of(spec))]
    plan(configs, fleet_workers(workers), spec.memory_gib)


def train_units(
    spec: PanelSpec,
    directory: RunDirectory,
    units: Sequence[Unit],
    workers: int | None,
    progress: bool,
) -> None:
    """Train all policies that are not there yet, and mark each with its records as finished.

    Args:
        spec: the panel.
        directory: held by the caller.
        units: of the panel.
        workers: processes, if so many are requested.
        progress: show a bar.
    """
    from integ_gym.train import fleet
    from integ_gym.train.fleet_evidence import TrainingEvidence

    waiting = [
        unit
        for unit in _trained(units)
        if not is_trained(directory, unit, training_key(training_config(spec, unit)))
    ]
    if not waiting:
        return
    configs = [training_config(spec, unit) for unit in waiting]
    folders = [directory.policies / unit.policy for unit in waiting]
    for unit, folder in zip(waiting, folders, strict=True):
        directory.discard_remains(unit.training)
        shutil.rmtree(folder, ignore_errors=True)
    evidence = [
        TrainingEvidence(directory.evidence, unit.training, training_context(spec, unit, config))
        for unit, config in zip(waiting, configs, strict=True)
    ]
    fleet.train_fleet(
        configs,
        folders,
        evidence=evidence,
        progress=progress,
        workers=workers,
        memory_gib=spec.memory_gib,
        on_trained=partial(_mark, spec, directory, waiting, time.time()),
    )


def _mark(
    spec: PanelSpec,
    directory: RunDirectory,
    units: Sequence[Unit],
    start: float,
    place: int,
    trained: TrainedPolicy,
) -> None:
    """Note a policy as finished, with its share of the time since ``start``."""
    unit = units[place]
    key = training_key(training_config(spec, unit))
    share = float(trained.card["wall_seconds"])
    directory.finish(unit.training, key, start, share, policy=trained.content_hash)


def _trained(units: Sequence[Unit]) -> list[Unit]:
    return [unit for unit in units if unit.home is not None]
