"""Training runs side by side in worker processes: what both trainers have in common."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import BrokenExecutor, Executor, Future
from contextlib import AbstractContextManager, contextmanager
from itertools import repeat
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar

from integ_gym.support.processes.workers import (
    Progress,
    cores,
    report_work,
    work_bar,
)
from integ_gym.support.sharing.clusters import Cluster, cluster_of
from integ_gym.support.sharing.resources import Resources

from ..policy_files.sidecar import TrainedPolicy, check_folder
from .error import TrainingError
from .evidence import TrainingEvidence

if TYPE_CHECKING:
    from .config import TrainingConfig

OnTrained: TypeAlias = Callable[[int, TrainedPolicy], Any]
"""Told the place of a policy among the configurations once it and its evidence are written."""


Jobs: TypeAlias = Mapping[tuple[int, ...], tuple[Any, ...]]
"""Arguments of each job, by the places of the policies that it trains."""

C = TypeVar("C", bound="TrainingConfig")

Run: TypeAlias = "tuple[C, Path, TrainingEvidence | None]"
"""A run, the folder for its policy and where its episodes are recorded."""


def unheard(place: int, trained: TrainedPolicy) -> None:
    """Nobody is told."""


def checked_runs(
    configs: Sequence[C],
    out_dirs: Sequence[str | Path],
    evidence: Sequence[TrainingEvidence] | None,
    force: bool,
) -> list[Run[C]]:
    """Runs with what belongs to each.

    Raises:
        OSError: if a folder is a file; or, unless ``force``, if there is a policy in it.
        ValueError: if folders or evidence are not one per run.
    """
    counts = len(out_dirs), len(configs if evidence is None else evidence)
    if counts != (len(configs), len(configs)):
        raise ValueError(
            f"`out_dirs` and `evidence` must have one entry per configuration ({len(configs)}), "
            f"got {counts[0]} and {'none' if evidence is None else counts[1]}"
        )
    folders = [check_folder(out, force) for out in out_dirs]
    return list(zip(configs, folders, evidence or repeat(None), strict=False))


def train_each(
    train_run: Callable[..., TrainedPolicy],
    runs: Sequence[Run[Any]],
    progress: bool,
    workers: int | None,
    on_trained: OnTrained,
) -> list[TrainedPolicy]:
    """Train policies one by one, in this process if one worker is enough; see `train_ppo`."""
    processes = min(workers or cores(), len(runs))
    bar = training_bar(sum(run[0].rounded_steps for run in runs), len(runs), progress)
    if processes > 1:
        jobs: Jobs = {(place,): (train_run, *run) for place, run in enumerate(runs)}
        return train_in_processes(_train_and_report, jobs, processes, bar, on_trained)

    def tell(steps: int, words: str) -> None:
        bar.set_postfix_str(words, refresh=False)
        bar.update(steps)
        report_work(steps)

    trained = []
    with bar:
        for place, run in enumerate(runs):
            trained.append(train_run(*run, tell=tell))
            on_trained(place, trained[-1])
    return trained


def _train_and_report(train_run: Callable[..., TrainedPolicy], *run: Any) -> list[TrainedPolicy]:
    """One run, in a worker process."""
    return [train_run(*run, tell=lambda steps, words: report_work(steps))]


def train_in_processes(
    train: Callable[..., Sequence[Any]],
    jobs: Jobs,
    processes: int,
    bar: Any,
    on_trained: OnTrained,
    *,
    write: Callable[[int, Any], TrainedPolicy] = lambda place, trained: trained,
    prepare: Callable[[int], None] | None = None,
    starting: str = "",
    cluster: Cluster | None = None,
) -> list[TrainedPolicy]:
    """Do jobs in worker processes, and take in each as it ends.

    Args:
        train: a job; importable from a module. What it reports as work moves the bar.
        jobs: what is to be trained.
        processes: at most so many at once; 0: none, but this one.
        bar: see :func:`training_bar`; closed at the end.
        on_trained: told of each policy.
        write: called here for each place with what ``train`` returned for it.
        prepare: called once in each process but this one, with its number from 0.
        starting: what the bar says until some work is done.
        cluster: an engine of others, in place of processes of this machine.

    Raises:
        TrainingError: if a job fails or is killed; finished policies stay.
    """
    trained: dict[int, TrainedPolicy] = {}
    progress, policies = Progress(bar, starting), sum(map(len, jobs))
    if cluster is not None:
        made: AbstractContextManager[Executor] = cluster.pool(progress, prepare)
    elif processes:
        made = progress.pool(max(1, min(processes, len(jobs))), prepare)
    else:
        made = progress.at_once()
    with bar, made as pool:
        running = {pool.submit(train, *given): places for places, given in jobs.items()}
        for future in progress.ended(running):
            outcomes = _result(future, len(trained))
            for place, outcome in zip(running.pop(future), outcomes, strict=True):
                trained[place] = write(place, outcome)
                on_trained(place, trained[place])
            bar.set_postfix_str(f"{len(trained)} of {policies} policies", refresh=False)
    return [trained[place] for place in sorted(trained)]


def _result(future: Future[Sequence[Any]], finished: int) -> Sequence[Any]:
    """What a worker returned.

    Raises:
        TrainingError: if it failed, or was killed.
    """
    kept = f"finished policies are kept ({finished})"
    try:
        return future.result()
    except BrokenExecutor:
        raise TrainingError(
            "a worker process was killed, perhaps for want of memory; give fewer workers, or the "
            f"fleet a smaller `memory_gib`; {kept}"
        ) from None
    except Exception as error:
        raise TrainingError(f"training failed: {error}; {kept}") from error


@contextmanager
def used(
    executor: str | Cluster, address: str | None, workers: int | None, memory_gib: float | None
) -> Iterator[Cluster | None]:
    """An engine of others, by name or as it is; None: processes of this machine.

    Raises:
        ClusterError: see :func:`integ_gym.support.cluster_of`.
    """
    if not isinstance(executor, str):
        yield executor if executor.remote else None
        return
    with cluster_of(executor, address, Resources(workers, memory_gib=memory_gib)) as cluster:
        yield cluster if cluster.remote else None


def training_bar(decisions: int, policies: int, shown: bool) -> Any:
    """A bar over the decisions of all policies, on stderr."""
    label = f"PPO, {policies} {'policy' if policies == 1 else 'policies'}"
    return work_bar(label, decisions, shown, unit=" steps", unit_scale=True)
