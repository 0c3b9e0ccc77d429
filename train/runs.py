"""Training runs: with PPO or SAC, one by one or in worker processes."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence, Sized
from concurrent.futures import BrokenExecutor, Future
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from itertools import repeat
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final, TypeAlias, TypeVar

from integ_gym.support.errors import InputError
from integ_gym.support.executors import Cluster, Resources, TaskPool, open_cluster
from integ_gym.support.files import read_files, write_files
from integ_gym.support.optional import require
from integ_gym.support.processes import Progress, report_work
from integ_gym.support.terminal import WorkBar, plural

from . import sac
from .config import TrainingConfig, TrainingError, TrainingEvidence
from .policy_files.sidecar import TrainedPolicy, check_folder
from .ppo import PPOConfig, train_run

OnTrained: TypeAlias = Callable[[int, TrainedPolicy], Any]
"""Called with a policy's index among the configurations once it and its evidence are written."""

C = TypeVar("C", bound=TrainingConfig)

Run: TypeAlias = "tuple[C, Path, TrainingEvidence | None]"
"""A run, the folder for its policy and where its episodes are recorded."""


def no_op(place: int, trained: TrainedPolicy) -> None:
    """Report nothing."""


def check_runs(
    configs: Sequence[C],
    out_dirs: Sequence[str | Path],
    evidence: Sequence[TrainingEvidence] | None,
    force: bool,
) -> list[Run[C]]:
    """Put what belongs to each run together.

    Raises:
        OSError: if a folder is a file; or, unless ``force``, if there is a policy in it.
        ValueError: if folders or evidence are not one per run.
    """
    counts = len(out_dirs), len(configs if evidence is None else evidence)
    if counts != (len(configs), len(configs)):
        raise InputError(
            f"`out_dirs` and `evidence` must have one entry per configuration ({len(configs)}), "
            f"got {counts[0]} and {'none' if evidence is None else counts[1]}"
        )
    folders = [check_folder(out, force) for out in out_dirs]
    return list(zip(configs, folders, evidence or repeat(None), strict=False))


def train_ppo(
    configs: Sequence[PPOConfig],
    out_dirs: Sequence[str | Path],
    *,
    evidence: Sequence[TrainingEvidence] | None = None,
    progress: bool = True,
    workers: int | None = None,
    force: bool = False,
    on_trained: OnTrained = no_op,
    tensorboard: bool = True,
    executor: str | Cluster = "local",
    address: str | None = None,
) -> list[TrainedPolicy]:
    """Train policies and write each: `policy.zip`, `policy.safetensors` and `policy.json`.

    Args:
        configs: the runs; they may differ in everything.
        out_dirs: a folder for each policy.
        evidence: where the training episodes of each are recorded; None: nowhere.
        progress: show a bar on stderr.
        workers: processes; by default one per core. A single run, or the runs of a single worker
            one after another, are trained in this process.
        force: replace policies that are already there.
        on_trained: called with the index in `configs` of every policy once it and its evidence are
            written.
        tensorboard: write logs beside each policy.
        executor: what runs the processes: see :func:`integ_gym.support.executors.open_cluster`.
        address: of a running cluster.

    Raises:
        OSError: if a folder cannot be used, or holds a policy and `force` is not given.
        TypeError, ValueError: for arguments that are not possible.
        ModuleNotFoundError: if the extra is missing, with the command that installs it.
        TrainingError: if a run fails or a worker is killed; finished policies stay.
    """
    require("train")
    runs = check_runs(configs, out_dirs, evidence, force)
    train = partial(train_run, tensorboard=tensorboard)
    return _train_each(train, runs, progress, workers, on_trained, executor, address)


def train_sac(
    configs: Sequence[sac.SACConfig],
    out_dirs: Sequence[str | Path],
    *,
    evidence: Sequence[TrainingEvidence] | None = None,
    progress: bool = True,
    workers: int | None = None,
    force: bool = False,
    on_trained: OnTrained = no_op,
    tensorboard: bool = True,
    executor: str | Cluster = "local",
    address: str | None = None,
) -> list[TrainedPolicy]:
    """Train policies and write each, as :func:`train_ppo` does.

    Raises:
        OSError: if a folder cannot be used, or holds a policy and `force` is not given.
        TypeError, ValueError: for arguments that are not possible, such as an environment whose
            actions are discrete.
        ModuleNotFoundError: if the extra is missing, with the command that installs it.
        TrainingError: if a run fails or a worker is killed; finished policies stay.
    """
    require("train")
    runs = check_runs(configs, out_dirs, evidence, force)
    train = partial(train_run, make_model=sac.make_model, tensorboard=tensorboard)
    return _train_each(train, runs, progress, workers, on_trained, executor, address)


@dataclass(frozen=True)
class Algorithm:
    """Its hyperparameters, and what trains with them."""

    config: type[TrainingConfig]
    train: Any


ALGORITHMS: Final[Mapping[str, Algorithm]] = {
    "ppo": Algorithm(PPOConfig, train_ppo),
    "sac": Algorithm(sac.SACConfig, train_sac),
}
"""The first is what trains where nothing else is said; the fleet trains it alone."""


def _train_each(
    train: Callable[..., TrainedPolicy],
    runs: Sequence[Run[Any]],
    progress: bool,
    workers: int | None,
    on_trained: OnTrained,
    executor: str | Cluster,
    address: str | None,
) -> list[TrainedPolicy]:
    """Train policies one by one, in this process if one worker is enough; see `train_ppo`."""
    bar = training_bar(sum(run[0].rounded_steps for run in runs), len(runs), progress)
    with resolve_executor(executor, address, workers) as cluster:
        if cluster.remote or min(cluster.workers, len(runs)) > 1:
            chunks = [(place,) for place in range(len(runs))]
            task = partial(_train_and_report, train)
            return train_in_processes(task, runs, chunks, cluster, bar, on_trained)

    def report(steps: int, words: str) -> None:
        bar.describe(words, draw=False)
        bar.update(steps)
        report_work(steps)

    trained = []
    with bar:
        for place, run in enumerate(runs):
            trained.append(train(*run, report=report))
            on_trained(place, trained[-1])
    return trained


def _train_and_report(
    train: Callable[..., TrainedPolicy], runs: Sequence[Run[Any]]
) -> list[TrainedPolicy]:
    """Runs one by one, in a worker process."""
    return [train(*run, report=lambda steps, words: report_work(steps)) for run in runs]


def train_in_processes(
    train: Callable[[Sequence[Run[Any]]], Sequence[Any]],
    runs: Sequence[Run[Any]],
    chunks: Sequence[tuple[int, ...]],
    cluster: Cluster,
    bar: Any,
    on_trained: OnTrained,
    *,
    write: Callable[[int, Any], TrainedPolicy] = lambda place, trained: trained,
    prepare: Callable[[int], None] | None = None,
    starting: str = "",
) -> list[TrainedPolicy]:
    """Train policies in worker processes, and take in each chunk of them as it ends.

    Args:
        train: trains a chunk; importable from a module. What it reports as work moves the bar. On
            other machines it returns policies that it has written.
        runs: the policies.
        chunks: places of those that are trained together.
        cluster: where.
        bar: see :func:`training_bar`; closed at the end.
        on_trained: called with each policy.
        write: called here for each place with what ``train`` returned for it on this machine.
        prepare: called once in each process but this one, with its number from 0.
        starting: what the bar says until some work is done.

    Raises:
        TrainingError: if a chunk fails, or its workers are lost again and again; finished policies
            stay.
    """
    trained: dict[int, TrainedPolicy] = {}
    progress = Progress(bar, starting)
    first = (_train_in_scratch, train) if cluster.remote else (train,)
    tasks = {places: (*first, [runs[place] for place in places]) for places in chunks}
    if not cluster.remote:
        cluster = replace(cluster, workers=min(cluster.workers, len(chunks)))

    def discard(places: tuple[int, ...]) -> None:
        """Remove the episodes that a worker wrote before it was lost."""
        for evidence in (runs[place][2] for place in places):
            if evidence is not None and not cluster.remote:
                evidence.discard()

    with bar, TaskPool(cluster, progress, prepare) as pool:
        for places, outcomes in _results(pool.run(tasks, discard), trained):
            for place, outcome in zip(places, outcomes, strict=True):
                policy = _keep(runs[place], outcome) if cluster.remote else write(place, outcome)
                trained[place] = policy
                on_trained(place, policy)
            bar.describe(f"{len(trained)} of {len(runs)} done", draw=False)
    return [trained[place] for place in sorted(trained)]


def _results(
    ended: Iterator[tuple[tuple[int, ...], Future[Any]]], finished: Sized
) -> Iterator[tuple[tuple[int, ...], Sequence[Any]]]:
    """Places of each chunk that ends, and what its worker returned.

    Raises:
        TrainingError: if one failed, or workers were lost again and again; it says how many
            policies are finished then.
    """
    kept = "finished policies are kept"
    try:
        for places, future in ended:
            yield places, future.result()
    except BrokenExecutor:
        raise TrainingError(
            "worker processes were killed again and again, perhaps because memory ran out; give "
            f"fewer workers, or the fleet a smaller `memory_gib`; {kept} ({len(finished)})"
        ) from None
    except Exception as error:
        raise TrainingError(f"training failed: {error}; {kept} ({len(finished)})") from error


def _train_in_scratch(
    train: Callable[[Sequence[Run[Any]]], Sequence[TrainedPolicy]], runs: Sequence[Run[Any]]
) -> list[tuple[TrainedPolicy, dict[str, bytes], dict[str, bytes]]]:
    """Train a chunk on another machine: policies, each with its files and those of its episodes."""
    with TemporaryDirectory(prefix="integ-gym-") as scratch:
        moved, folders = [], [Path(scratch) / str(place) for place in range(len(runs))]
        for (config, _, evidence), folder in zip(runs, folders, strict=True):
            (folder / "policy").mkdir(parents=True)
            own = None if evidence is None else replace(evidence, store=folder / "evidence")
            moved.append((config, folder / "policy", own))
        return [
            (policy, read_files(folder / "policy"), read_files(folder / "evidence"))
            for policy, folder in zip(train(moved), folders, strict=True)
        ]


def _keep(
    run: Run[Any], result: tuple[TrainedPolicy, dict[str, bytes], dict[str, bytes]]
) -> TrainedPolicy:
    """Write here what was trained elsewhere."""
    (policy, files, episodes), (_, folder, evidence) = result, run
    if evidence is not None:
        write_files(evidence.store, episodes)
    write_files(folder, files)
    return replace(policy, policy=folder / policy.policy.name, sidecar=folder / policy.sidecar.name)


@contextmanager
def resolve_executor(
    executor: str | Cluster,
    address: str | None = None,
    workers: int | None = None,
    memory_gib: float | None = None,
) -> Iterator[Cluster]:
    """Where to train, by name or as it is.

    Raises:
        ClusterError: see :func:`integ_gym.support.executors.open_cluster`.
    """
    if isinstance(executor, Cluster):
        yield executor
        return
    with open_cluster(executor, address, Resources(workers, memory_gib=memory_gib)) as cluster:
        yield cluster


def training_bar(decisions: int, policies: int, shown: bool) -> WorkBar:
    """A bar over the decisions of all policies, on stderr."""
    label = f"PPO, {plural(policies, 'policy', 'policies')}"
    return WorkBar(label, decisions, shown, unit=" steps")
