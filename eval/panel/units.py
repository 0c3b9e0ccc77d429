"""Units of work of a panel, and the workers that they are given to."""

from __future__ import annotations

import errno
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import BrokenExecutor
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from integ_gym.envs.engines.stepping import engine_versions
from integ_gym.support.errors import IntegGymError
from integ_gym.support.executors import Cluster, TaskPool
from integ_gym.support.files import read_files
from integ_gym.support.processes import Progress
from integ_gym.train.baselines import make_baseline, possible_baselines
from integ_gym.train.config import TrainingConfig
from integ_gym.train.policy import Policy
from integ_gym.train.policy_files.card import card_hash
from integ_gym.train.policy_files.sidecar import policy_file

from .cells import Home, file_name, training_arguments
from .run_directory import RunDirectory, key_of
from .spec import ALGORITHM, PanelSpec

HANDMADE = "handmade"
"""Name of the baseline that tries cells."""


@dataclass(frozen=True)
class Unit:
    """One training run with its evaluation, or the evaluation of one baseline.

    Attributes:
        row: name of the panel's row.
        home: training discretization or mixture, or None for a baseline.
        seed: training seed, or None.
    """

    row: str
    home: Home | None = None
    seed: int | None = None

    @property
    def policy(self) -> str:
        """Identifier of the policy, usable as a file name."""
        seed = "" if self.seed is None else f"-seed{self.seed}"
        return file_name(self.row) + seed

    @property
    def training(self) -> str:
        """Name of the training unit."""
        return f"train-{self.policy}"


def units_of(spec: PanelSpec) -> tuple[Unit, ...]:
    """Baselines first, which are quick, then the training runs, seed by seed."""
    return (*(Unit(name) for name in spec.baselines), *trained_units(spec))


def trained_units(spec: PanelSpec) -> tuple[Unit, ...]:
    """The training runs, seed by seed."""
    return tuple(
        Unit(spec.name_of(home), home, seed)
        for seed in spec.seeds
        for home in spec.train
        if seed in spec.seeds_of(home)
    )


def baseline_of(spec: PanelSpec, name: str) -> Policy:
    """A baseline of a panel.

    Raises:
        ValueError: for one that cannot be made.
    """
    return make_baseline(name, spec.nominal, controller=spec.testbed.controller)


def has_controller(spec: PanelSpec) -> bool:
    """Whether a hand-made controller can try the cells of a panel."""
    return HANDMADE in possible_baselines(spec.nominal, spec.testbed.controller)


def training_config(spec: PanelSpec, unit: Unit) -> TrainingConfig:
    """Hyperparameters of one training run."""
    assert unit.home is not None
    settings = {name: value for name, value in spec.training.items() if name != ALGORITHM}
    return spec.algorithm.config.of(
        spec.env_id,
        env_arguments=training_arguments(unit.home, spec.environment),
        seed=unit.seed,
        **settings,
    )


def training_key(spec: PanelSpec, unit: Unit) -> str:
    """Hash of all that a training run depends on."""
    config = training_config(spec, unit)
    arguments = config.env_arguments
    members = (arguments, *arguments.get("mixture", ()))
    engines = {member["engine"] for member in members if "engine" in member}
    return key_of(engine_versions(engines), config=asdict(config))


def is_trained(spec: PanelSpec, directory: RunDirectory, unit: Unit) -> bool:
    """Whether the policy of a panel's unit and its records are there.

    Raises:
        RunDirectoryError: if they are of another configuration or version.
    """
    policy = policy_file(directory.policies / unit.policy)
    return directory.finished(unit.training, training_key(spec, unit), policy) is not None


def is_card_of(card: Mapping[str, Any], marker: Mapping[str, Any]) -> bool:
    """Whether a side-car is the one that a training unit ended with.

    Markers of before side-cars had a hash of themselves tell the policy's alone.
    """
    if marker.get("policy") != card.get("content_hash"):
        return False
    return "card" not in marker or marker["card"] == card_hash(card)


class PanelError(IntegGymError, RuntimeError):
    """A unit of work that failed, in one sentence."""


@dataclass(frozen=True)
class Work:
    """Units of a run given to workers, each committed as it ends.

    Attributes:
        directory: of the run, held by this process.
        cluster: where.
        pool: runs tasks there.
        progress: work that they have reported.
        bar: shows it.
    """

    directory: RunDirectory
    cluster: Cluster
    pool: TaskPool
    progress: Progress
    bar: Any

    def commit(
        self, phase: str, task: Callable[..., None], units: Mapping[str, tuple[Any, ...]]
    ) -> None:
        """Do units, and have the files and the marker of each in place once it ends.

        Args:
            phase: what is done, in words.
            task: does a unit, and marks it as finished. Its first arguments are a specification
                and the directory that it writes to.
            units: by name, the specification and what follows the directory.

        Raises:
            PanelError: if one fails; what was finished stays.
        """
        directory = self.directory
        first: tuple[Callable[..., Any], ...] = (task,)
        if self.cluster.remote:
            directory, first = directory.copy_for_workers(), (_do_in_scratch, task)
        tasks = {unit: (*first, spec, directory, *given) for unit, (spec, *given) in units.items()}
        for _, files in self._results(phase, tasks, self.directory.discard_remains):
            if self.cluster.remote:
                self.directory.take(files)
            self.directory.storage.send()

    def each(
        self, phase: str, task: Callable[..., Any], arguments: Mapping[str, tuple[Any, ...]]
    ) -> Iterator[tuple[str, Any]]:
        """Run one task for each of ``arguments``, by name; what they return, as they end.

        Raises:
            PanelError: if one fails.
        """
        tasks = {name: (task, *given) for name, given in arguments.items()}
        return self._results(phase, tasks, lambda name: None)

    def _results(
        self, phase: str, tasks: Mapping[str, tuple[Any, ...]], discard: Callable[[str], None]
    ) -> Iterator[tuple[str, Any]]:
        self.bar.describe(phase)
        try:
            for name, future in self.pool.run(tasks, discard):
                error = future.exception()
                if isinstance(error, Exception):
                    message = f"{phase} {name} failed: {_format_error(error)}"
                    raise PanelError(f"{message}; the rest is kept") from error
                yield name, future.result()
        except BrokenExecutor as error:
            raise PanelError(
                f"worker processes were lost again and again while {phase}, perhaps because "
                "memory ran out; run the same command again to go on, with fewer --workers if it "
                "happens again"
            ) from error


def _do_in_scratch(
    task: Callable[..., None], spec: PanelSpec, directory: RunDirectory, *given: Any
) -> dict[str, bytes]:
    """Do a unit on a machine that does not see the run's directory; the files that it wrote."""
    with TemporaryDirectory(prefix="integ-gym-") as scratch:
        task(spec, directory.moved(Path(scratch)), *given)
        return read_files(Path(scratch))


def _format_error(error: Exception) -> str:
    """What an error says, with its type where that helps; of a full disk the remedy."""
    if isinstance(error, OSError) and error.errno == errno.ENOSPC:
        return f"{error}: free some space, and run the same command again to go on"
    own = type(error).__module__.partition(".")[0] == "integ_gym"
    if own or isinstance(error, ValueError):
        return str(error)
    return f"{type(error).__name__}: {error}"


@contextmanager
def open_work(
    directory: RunDirectory,
    cluster: Cluster,
    bar: Any,
    prepare: Callable[[int], None] | None = None,
) -> Iterator[Work]:
    """What does a run's units, for as long as the block lasts.

    Args:
        directory: of the run, held by this process.
        cluster: where.
        bar: the bar; closed at the end.
        prepare: called once in each process.
    """
    with bar:
        progress = Progress(bar)
        with TaskPool(cluster, progress, prepare) as pool:
            yield Work(directory, cluster, pool, progress, bar)
