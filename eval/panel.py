"""The panel: training runs and evaluations in a pool of processes, resumable."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from dataclasses import replace
from pathlib import Path
from typing import Any

from tqdm import tqdm

from integ_gym.envs.registration import environment_setup
from integ_gym.eval.evaluation import Subject
from integ_gym.eval.evaluation_units import batches_of, evaluate_batch, not_evaluated
from integ_gym.eval.expected_time import cell_seconds, cells_seconds
from integ_gym.eval.panel_training import check_training, train_units
from integ_gym.eval.reuse import FinishedPolicies
from integ_gym.eval.run_directory import RunDirectory
from integ_gym.eval.spec import PanelSpec, SpecError
from integ_gym.eval.units import Unit, units_of
from integ_gym.train.baselines import make_baseline
from integ_gym.train.sidecar import POLICY_FILE, read_trained
from integ_gym.train.worker import Progress, cores, report_work


class PanelError(RuntimeError):
    """A unit of work that failed, in one sentence."""


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
            if unit.home is None:
                make_baseline(unit.row, nominal_setup(spec))
        check_training(spec, workers)
    except (TypeError, ValueError) as error:
        raise SpecError(f"panel {spec.name!r}: {error}") from error


def nominal_setup(spec: PanelSpec) -> Any:
    """The unperturbed reference environment, from whose parameters baselines are designed."""
    truth = spec.columns()[-1]
    return environment_setup(spec.env_id, truth.arguments(spec.environment))


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
    train_units(spec, directory, units, requested, progress)
    shared = Progress()
    with shared.pool(workers) as pool, _bar(spec, units, progress) as bar:
        work = _Work(pool, shared, bar)
        subjects = [subject_of(spec, directory, unit) for unit in units]
        waiting = not_evaluated(spec, directory, subjects)
        work.skip(_evaluation_seconds(spec, subjects) - _evaluation_seconds(spec, waiting))
        batches = batches_of(spec, waiting, workers)
        work.do("evaluating", _evaluate, {_named(b): (spec, directory, b) for b in batches})


def _bar(spec: PanelSpec, units: Sequence[Unit], shown: bool) -> Any:
    total = sum(cells_seconds(spec, spec.cells_of(unit.home)) for unit in units)
    return tqdm(
        total=total,
        desc=f"panel {spec.name}",
        disable=not shown,
        mininterval=0.5 if sys.stderr.isatty() else 15.0,
        smoothing=0.05,
        bar_format="{l_bar}{bar}| elapsed {elapsed}, about {remaining} left{postfix}",  # ", phase"
    )


class _Work:
    """Tasks given to a pool, and the bar that shows what is done of them.

    Args:
        pool: the pool.
        shared: what its workers report.
        bar: the bar.
    """

    def __init__(self, pool: ProcessPoolExecutor, shared: Progress, bar: Any) -> None:
        self._pool = pool
        self._shared = shared
        self._bar = bar
        self._skipped = 0.0

    def skip(self, seconds: float) -> None:
        """Count work that was done before."""
        self._skipped += seconds
        self._show()

    def do(
        self, phase: str, task: Callable[..., None], arguments: Mapping[str, tuple[Any, ...]]
    ) -> None:
        """Run one task for each of ``arguments``, by name.

        Raises:
            PanelError: if one fails.
        """
        running = {self._pool.submit(task, *given): name for name, given in arguments.items()}
        self._bar.set_postfix_str(phase, refresh=False)
        while running:
            ended, _ = wait(running, timeout=0.5, return_when=FIRST_COMPLETED)
            for future in ended:
                name = running.pop(future)
                try:
                    future.result()
                except Exception as error:
                    raise PanelError(f"{phase} {name} failed: {error}; the rest is kept") from error
            self._show()

    def _show(self) -> None:
        done = self._shared.total() + self._skipped
        self._bar.update(min(self._bar.total, done) - self._bar.n)


def _named(batch: Sequence[Subject]) -> str:
    return ", ".join(subject.policy.policy_id for subject in batch)


def _evaluation_seconds(spec: PanelSpec, subjects: Sequence[Subject]) -> float:
    return sum(cells_seconds(spec, subject.cells) for subject in subjects)


def _evaluate(spec: PanelSpec, directory: RunDirectory, batch: Sequence[Subject]) -> None:
    evaluate_batch(
        spec, directory, batch, lambda cell, n: report_work(n * cell_seconds(spec, cell))
    )


def subject_of(spec: PanelSpec, directory: RunDirectory, unit: Unit) -> Subject:
    """The policy of a unit, read from its file or built."""
    cells = spec.cells_of(unit.home)
    if unit.home is None:
        return Subject(make_baseline(unit.row, nominal_setup(spec)), cells)
    policy, card = read_trained(directory.policies / unit.policy / POLICY_FILE)
    marker = directory.marker(unit.training)
    if marker is None or marker.get("policy") != card["content_hash"]:
        raise PanelError(
            f"policies/{unit.policy} is not the policy that this panel trained; restore it, or "
            "give another directory with --out"
        )
    return Subject(replace(policy, policy_id=unit.policy), cells, unit.home, unit.seed)
