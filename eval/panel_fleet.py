"""Training of a panel's policies by the fleet trainer."""

from __future__ import annotations

import shutil
import time
from collections.abc import Sequence
from functools import partial

from integ_gym.envs.engines import ENGINES
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


def check_fleet(spec: PanelSpec) -> None:
    """Check that the fleet can train every policy of a panel.

    Raises:
        ModuleNotFoundError: without the extra, with the command that installs it.
        TypeError, ValueError: for a run that it cannot train.
    """
    require("fleet")
    for trained in spec.trained_on():
        if not ENGINES.load(trained.engine).batched:
            raise ValueError(
                f"the fleet cannot train on {trained.name!r}: engine {trained.engine!r} is not "
                'made of JAX\'s operations; use `trainer = "sb3"`'
            )
    from integ_gym.train import fleet

    fleet.plan([training_config(spec, unit) for unit in _trained(units_of(spec))], workers=1)


def train_units(
    spec: PanelSpec,
    directory: RunDirectory,
    units: Sequence[Unit],
    workers: int,
    progress: bool,
) -> None:
    """Train all policies that are not there yet, and mark each with its records as finished.

    Args:
        spec: the panel.
        directory: held by the caller.
        units: of the panel.
        workers: processes.
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
