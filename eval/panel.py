"""The panel: training runs and evaluations in a pool of processes, resumable."""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from integ_gym.eval.evaluation import Subject
from integ_gym.eval.evaluation_units import evaluate_all
from integ_gym.eval.expected_time import cells_seconds, training_decision_seconds
from integ_gym.eval.panel_fleet import check_fleet, train_units
from integ_gym.eval.reuse import FinishedPolicies
from integ_gym.eval.run_directory import RunDirectory
from integ_gym.eval.spec import PanelSpec, SpecError
from integ_gym.eval.units import (
    Unit,
    is_trained,
    training_config,
    training_context,
    training_key,
    units_of,
)
from integ_gym.eval.work import PanelError, working
from integ_gym.evidence.store import EvidenceStore
from integ_gym.evidence.vector_recorder import RecordVectorEvidence
from integ_gym.train.baselines import make_baseline
from integ_gym.train.policy.interface import Policy
from integ_gym.train.ppo import train
from integ_gym.train.sidecar import POLICY_FILE, read_trained
from integ_gym.train.worker import cores, report_work


def check_spec(spec: PanelSpec, workers: int | None = None) -> None:
    """Check what only the trainer and the baselines know.

    Args:
        spec: the panel.
        workers: processes, if so many are requested.

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
    try:
        for unit in units_of(spec):
            if unit.home is not None:
                training_config(spec, unit)
            else:
                baseline_of(spec, unit.row)
        if spec.fleet:
            check_fleet(spec, workers)
    except (TypeError, ValueError) as error:
        raise SpecError(f"panel {spec.name!r}: {error}") from error


def baseline_of(spec: PanelSpec, name: str) -> Policy:
    """A baseline of a panel.

    Raises:
        ValueError: for one that cannot be made.
    """
    return make_baseline(name, spec.nominal, controller=spec.testbed.controller)


def run_panel(
    spec: PanelSpec,
    out: Path,
    *,
    workers: int | None = None,
    progress: bool = True,
    policies: Path | None = None,
    finish: Callable[[RunDirectory], None] = lambda directory: None,
) -> RunDirectory:
    """Train and evaluate everything that is not finished yet.

    Args:
        spec: the panel.
        out: its directory.
        workers: processes; by default one per core.
        progress: show a bar with the remaining time.
        policies: directory of a finished panel whose policies are taken instead of training.
        finish: called at the end, while the directory is still held.

    Raises:
        SpecError, RunDirectoryError: for what cannot be run, before anything is written.
        PanelError: if a unit of work fails; what was finished stays.
    """
    check_spec(spec, workers)
    directory = RunDirectory(out, spec.to_json(), spec.engine_versions())
    finished = None if policies is None else FinishedPolicies(policies, spec)
    with directory.opened():
        if finished is not None:
            finished.bring(directory)
        _run_units(spec, directory, workers, progress)
        finish(directory)
    return directory


def _run_units(
    spec: PanelSpec, directory: RunDirectory, requested: int | None, progress: bool
) -> None:
    units, workers = units_of(spec), requested or cores()
    if spec.fleet:
        train_units(spec, directory, units, requested, progress)
    with working(f"panel {spec.name}", _total(spec, units), workers, progress) as work:
        if not spec.fleet:
            trained = [unit for unit in units if unit.home is not None]
            work.do("training", _train_unit, {u.policy: (spec, directory, u) for u in trained})
        subjects = [subject_of(spec, directory, unit) for unit in units]
        evaluate_all(spec, directory, subjects, work, workers)


def _total(spec: PanelSpec, units: Sequence[Unit]) -> float:
    """Expected work, s."""
    total = sum(cells_seconds(spec, spec.cells_of(unit.home)) for unit in units)
    if not spec.fleet:
        total += sum(_training_seconds(spec, unit) for unit in units if unit.home is not None)
    return total


def _training_seconds(spec: PanelSpec, unit: Unit) -> float:
    assert unit.home is not None
    return training_config(spec, unit).total_steps * training_decision_seconds(unit.home)


def _train_unit(spec: PanelSpec, directory: RunDirectory, unit: Unit) -> None:
    """Train one policy and mark it finished, unless it is."""
    assert unit.home is not None
    config, each = training_config(spec, unit), training_decision_seconds(unit.home)
    key = training_key(config)
    if is_trained(directory, unit, key):
        report_work(_training_seconds(spec, unit))
        return
    directory.discard_remains(unit.training)
    final = directory.policies / unit.policy
    shutil.rmtree(final, ignore_errors=True)
    start = time.time()
    store = EvidenceStore(directory.evidence)
    context = training_context(spec, unit, config)
    recorders: list[RecordVectorEvidence] = []

    def recorded(environment: Any) -> RecordVectorEvidence:
        recorders.append(RecordVectorEvidence(environment, store, context, commit_on_close=False))
        return recorders[-1]

    trained = train(
        config,
        final,
        progress=False,
        on_steps=lambda steps: report_work(steps * each),
        wrap=recorded,
        tensorboard=False,
    )
    recorders[-1].commit(unit.training)
    directory.finish(unit.training, key, start, policy=trained.content_hash)


def subject_of(spec: PanelSpec, directory: RunDirectory, unit: Unit) -> Subject:
    """The policy of a unit, read from its file or built."""
    cells = spec.cells_of(unit.home)
    if unit.home is None:
        return Subject(baseline_of(spec, unit.row), cells)
    policy, card = read_trained(directory.policies / unit.policy / POLICY_FILE)
    marker = directory.marker(unit.training)
    if marker is None or marker.get("policy") != card["content_hash"]:
        raise PanelError(
            f"policies/{unit.policy} is not the policy that this panel trained; restore it, or "
            "give another directory with --out"
        )
    return Subject(replace(policy, policy_id=unit.policy), cells, unit.home, unit.seed)
