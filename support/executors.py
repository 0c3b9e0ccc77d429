"""Where tasks run: processes of this machine, Ray, Dask, Slurm, or an executor of the user's own.

The driver gives tasks out and takes their results in; what runs them knows nothing of the rest.
"""

from __future__ import annotations

import contextlib
import io
import logging
import os
import sys
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import BrokenExecutor, Executor, Future, ThreadPoolExecutor
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from itertools import islice
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple, TypeAlias, TypeVar

from .errors import IntegGymError
from .optional import load
from .processes import Progress, cores, limit_threads, reporting

EXECUTORS = ("local", "ray", "dask", "slurm")
"""Executors by name; ``"module:function"`` is any other."""

MOST_LOSSES = 3
"""Losses of worker processes in a row, without a task finished between them, that end a run."""

RETRIES = 5
"""How often Ray itself runs a task again whose process or node was lost."""

JOB_MINUTES = 60
"""Time limit of a Slurm job unless ``SBATCH_TIMELIMIT`` gives another, min."""

POLL_SECONDS = 0.5
"""Time between two looks at a Slurm job, s."""

AHEAD = 2
"""Tasks for each worker that are given out and not yet taken in, at most: what they return waits in
memory here where it is taken in more slowly than it comes."""

LEAST_AHEAD = 64
"""The same of a cluster, whose workers may be more than are known."""

MOST_TEXT = 10_000
"""Characters of what a task prints that come back, from its end."""

Key = TypeVar("Key")

Task: TypeAlias = tuple[Any, ...]
"""A function, importable from a module, and its arguments."""

Prepare: TypeAlias = Callable[[int], None] | None
"""Called once in each process before its first task, with the process's number, or 0."""


class ClusterError(IntegGymError, ValueError):
    """An executor that cannot be used, in one sentence with the remedy."""


@dataclass(frozen=True)
class Resources:
    """What is asked for.

    Attributes:
        workers: processes; None: as many as there is room for.
        cores: of each worker.
        gpus: of each worker.
        memory_gib: that all workers together may take; None: nothing is asked for.
    """

    workers: int | None = None
    cores: int = 1
    gpus: float = 0
    memory_gib: float | None = None

    def __post_init__(self) -> None:
        if self.cores < 1:
            raise ClusterError(f"a worker has 1 core or more, got {self.cores}")
        if not self.gpus >= 0:
            raise ClusterError(f"a worker has 0 GPUs or more, got {self.gpus}")

    @property
    def local_workers(self) -> int:
        """Workers that were asked for, or that this machine has room for."""
        return self.workers or max(1, cores() // self.cores)


@dataclass(frozen=True)
class Cluster:
    """Where tasks run.

    Attributes:
        workers: processes at work at once; 0: none but this one.
        gpus: of each of them.
        connect: returns an executor whose processes may be on other machines; it is called again
            once they are lost. None: processes of this machine, started for each pool.
        lost: errors that mean for that executor that a worker was lost, beside `BrokenExecutor`.
    """

    workers: int
    gpus: float = 0
    connect: Callable[[], Executor] | None = None
    lost: tuple[type[BaseException], ...] = ()

    @property
    def remote(self) -> bool:
        """Whether tasks may run on other machines, and so return all that they write."""
        return self.connect is not None

    @contextmanager
    def pool(self, progress: Progress, prepare: Prepare = None) -> Iterator[Executor]:
        """An executor of tasks; an error that leaves the block cancels what waits.

        Args:
            progress: receives the work that tasks report.
            prepare: called once in each process.
        """
        if self.connect is None:
            local = progress.pool(self.workers, prepare) if self.workers else progress.at_once()
            with local as executor:
                yield executor
            return
        remote = RemoteExecutor(self.connect(), progress, prepare, self.lost)
        try:
            yield remote
        except BaseException:
            remote.cancel()
            raise


class TaskPool:
    """Runs tasks; one whose worker died is given to another.

    Args:
        cluster: where.
        progress: receives the work that tasks report.
        prepare: called once in each process.
    """

    def __init__(self, cluster: Cluster, progress: Progress, prepare: Prepare = None) -> None:
        self._open: Callable[[], AbstractContextManager[Executor]]
        self._open = partial(cluster.pool, progress, prepare)
        self._ahead = max(1, AHEAD * cluster.workers, LEAST_AHEAD if cluster.remote else 0)
        self._progress = progress
        self._stack = ExitStack()

    def __enter__(self) -> TaskPool:
        self._executor = self._stack.enter_context(self._open())
        return self

    def __exit__(self, *raised: Any) -> bool | None:
        return self._stack.__exit__(*raised)

    def run(
        self, tasks: Mapping[Key, Task], discard: Callable[[Key], None] = lambda key: None
    ) -> Iterator[tuple[Key, Future[Any]]]:
        """The tasks' futures, each done, in the order in which they end.

        Args:
            tasks: by keys.
            discard: called for each that is given to another worker, before it is: removes what
                the one before may have left.

        Raises:
            BrokenExecutor: if workers are lost again and again.
        """
        waiting, losses = dict(tasks), 0
        while waiting:
            before = len(waiting)
            try:
                yield from self._run_once(waiting)
            except BrokenExecutor as error:
                losses = losses + 1 if len(waiting) == before else 1
                if losses == MOST_LOSSES:
                    raise
                print(
                    f"A worker process was lost ({error or type(error).__name__}); what it did is "
                    "given to another.",
                    file=sys.stderr,
                )
                self._stack.close()
                for key in waiting:
                    discard(key)
                self._executor = self._stack.enter_context(self._open())

    def _run_once(self, waiting: dict[Key, Task]) -> Iterator[tuple[Key, Future[Any]]]:
        """Remove from what waits all that ends.

        Raises:
            BrokenExecutor: at the end, if a worker was lost.
        """
        later, given = iter([*waiting.items()]), dict[Future[Any], Key]()
        running = set[Future[Any]]()

        def give_out(count: int) -> BrokenExecutor | None:
            """Give more to the workers; what says that they can take no more."""
            for key, task in islice(later, count):
                try:
                    future = self._executor.submit(*task)
                except BrokenExecutor as broken:
                    return broken
                given[future] = key
                running.add(future)
            return None

        lost = give_out(self._ahead)
        for future in self._progress.ended(running):
            key = given.pop(future)
            # an executor that lost its connection cancels
            error = BrokenExecutor("cancelled") if future.cancelled() else future.exception()
            if isinstance(error, BrokenExecutor):
                lost = error
            else:
                del waiting[key]
                yield key, future
            lost = give_out(1) or lost
        if lost is not None:
            raise lost


class RemoteExecutor(Executor):
    """Gives tasks to another executor, and passes on the work that they report and what they print.

    Args:
        executor: runs tasks in other processes.
        progress: receives the work that tasks report, as each ends.
        prepare: called once in each process before its first task, with 0.
        lost: errors that tell that a worker was lost.
    """

    def __init__(
        self,
        executor: Executor,
        progress: Progress,
        prepare: Prepare = None,
        lost: tuple[type[BaseException], ...] = (),
    ) -> None:
        self._executor = executor
        self._progress = progress
        self._prepare = prepare
        self._lost = lost
        self._gone: tuple[type[BaseException], ...] = (RuntimeError, ConnectionError, *lost)
        self._waiting: set[Future[Any]] = set()

    def submit(self, task: Callable[..., Any], /, *given: Any, **named: Any) -> Future[Any]:
        """Have a task run; what it prints is printed here, on standard error, when it ends.

        Raises:
            BrokenExecutor: if it takes no more tasks.
        """
        outer: Future[Any] = Future()
        try:
            inner = self._executor.submit(_run_task, self._prepare, task, given, named)
        except self._gone as error:
            raise BrokenExecutor(f"{type(error).__name__}: {error}") from error
        self._waiting.add(inner)

        def pass_on(ended: Future[Any]) -> None:
            self._waiting.discard(ended)
            if ended.cancelled():
                outer.cancel()
                outer.set_running_or_notify_cancel()
            elif (error := ended.exception()) is None:
                outer.set_result(self._take(ended.result()))
            elif isinstance(error, self._lost):
                first = str(error).strip().partition("\n")[0]
                outer.set_exception(BrokenExecutor(f"{type(error).__name__}: {first}"))
            else:
                outer.set_exception(error)

        inner.add_done_callback(pass_on)
        return outer

    def cancel(self) -> None:
        """Give up what waits."""
        for inner in [*self._waiting]:
            inner.cancel()

    def _take(self, outcome: _Outcome) -> Any:
        self._progress.add(outcome.work, show=False)
        if outcome.text:
            print(outcome.text, end="", file=sys.stderr, flush=True)
        return outcome.result


class _Outcome(NamedTuple):
    """What a task comes back with.

    Attributes:
        result: what it returned.
        work: that it reported.
        text: that it printed.
    """

    result: Any
    work: float
    text: str


_turn = threading.Lock()
_prepared: set[str] = set()


def _run_task(
    prepare: Prepare, task: Callable[..., Any], given: Sequence[Any], named: Mapping[str, Any]
) -> _Outcome:
    """Run a task in a worker elsewhere: one at a time, with one thread for its numbers."""
    with _turn:
        limit_threads()
        if prepare is not None and repr(prepare) not in _prepared:
            prepare(0)
            _prepared.add(repr(prepare))
        printed = io.StringIO()
        with (
            reporting() as work,
            contextlib.redirect_stdout(printed),
            contextlib.redirect_stderr(printed),
        ):
            result = task(*given, **named)
        return _Outcome(result, sum(work), printed.getvalue()[-MOST_TEXT:])


def open_cluster(
    executor: str = "local", address: str | None = None, resources: Resources | None = None
) -> AbstractContextManager[Cluster]:
    """An executor by name, for as long as the block lasts; what was started for it ends with it.

    Args:
        executor: one of :data:`EXECUTORS`, or ``"module:function"``: a function without arguments
            that returns a `concurrent.futures.Executor` of processes.
        address: of a running cluster of Ray or Dask, by default one is started on this machine;
            ``"local"`` runs Slurm's jobs on this machine.
        resources: what is asked for.

    Raises:
        ClusterError: for one that cannot be used.
        ModuleNotFoundError: if its extra is missing, with the command that installs it.
    """
    wanted = resources or Resources()
    if executor in _ENGINES:
        return _ENGINES[executor](address, wanted)
    if address is not None:
        raise ClusterError(
            f"--address names a cluster of Ray or Dask, not of {executor!r}; leave it out, or give "
            "--executor ray or --executor dask"
        )
    if executor == "local":
        if wanted.cores != 1 or wanted.gpus:
            raise ClusterError(
                "cores and GPUs of each worker are asked of an engine such as Ray; on this machine "
                "give --workers, and the fleet trains on the GPUs that JAX finds"
            )
        return contextlib.nullcontext(Cluster(wanted.local_workers))
    if ":" not in executor:
        raise ClusterError(
            f'--executor must be one of {", ".join(EXECUTORS)}, or "module:function" for an '
            f"executor of your own, got {executor!r}"
        )
    return _own_cluster(executor, wanted)


@contextmanager
def _own_cluster(reference: str, wanted: Resources) -> Iterator[Cluster]:
    """What a function of the user's own returns."""
    module, _, name = reference.partition(":")
    if wanted.cores != 1:
        raise ClusterError(
            f"{reference!r} decides itself how many cores its processes have; leave "
            "--cores-per-worker out"
        )
    opened: list[Any] = []

    def connect() -> Any:
        """The executor; a new one in place of one whose processes were lost."""
        broken = bool(opened) and getattr(opened[-1], "_broken", False)
        if broken or not opened:
            opened.append(_call(reference, module, name))
        return opened[-1]

    first = connect()
    own = getattr(first, "_max_workers", None)
    workers = wanted.workers or (own if isinstance(own, int) else cores())
    try:
        yield Cluster(workers, wanted.gpus, connect)
    finally:
        for executor in opened:
            executor.shutdown(wait=True, cancel_futures=True)


def _call(reference: str, module: str, name: str) -> Any:
    try:
        executor = getattr(import_module(module), name)()
    except Exception as error:  # whatever the user's function does
        raise ClusterError(
            f"cannot get an executor from {reference!r}: {type(error).__name__}: {error}; write it "
            'as "module:function", importable from here and called without arguments'
        ) from error
    if not callable(getattr(executor, "submit", None)):
        raise ClusterError(
            f"{reference!r} gives {type(executor).__name__}, which is no executor: it needs "
            "`submit`, as concurrent.futures.Executor has"
        )
    return executor


class RayExecutor(Executor):
    """Tasks of Ray as futures; Ray has no `concurrent.futures.Executor` of its own.

    Args:
        ray: the module, connected to a cluster.
        options: of every task.
    """

    def __init__(self, ray: Any, options: dict[str, Any]) -> None:
        self._remote = ray.remote(_call_with).options(**options)

    def submit(self, task: Callable[..., Any], /, *given: Any, **named: Any) -> Future[Any]:
        """Have a task run."""
        future: Future[Any] = self._remote.remote(task, given, named).future()
        return future


def _call_with(task: Callable[..., Any], given: Sequence[Any], named: Mapping[str, Any]) -> Any:
    return task(*given, **named)


@contextmanager
def _ray_cluster(address: str | None, wanted: Resources) -> Iterator[Cluster]:
    """A running cluster of Ray, or one that is started here, whose processes find our modules."""
    ray = load("ray", "ray")
    own: dict[str, Any] = {}
    if not address:
        paths = {"PYTHONPATH": os.pathsep.join(sys.path)}
        own = {
            "num_cpus": wanted.local_workers * wanted.cores,
            "include_dashboard": False,
            "runtime_env": {"env_vars": paths},
        }
    try:
        ray.init(
            address=address or "local",
            logging_level=logging.ERROR,
            log_to_driver=False,  # what tasks print comes back with them
            **own,
        )
    except ConnectionError as error:
        raise ClusterError(
            f"no cluster of Ray answers at {address}: {error}; start one with `ray start --head`, "
            "or leave out --address"
        ) from None
    try:
        workers = _ray_workers(ray.cluster_resources(), wanted)
        options = {"num_cpus": wanted.cores, "num_gpus": wanted.gpus, "max_retries": RETRIES}
        if wanted.memory_gib is not None:
            options["memory"] = int(wanted.memory_gib * 2**30 / workers)
        executor, faults = RayExecutor(ray, options), ray.exceptions
        lost = (faults.WorkerCrashedError, faults.NodeDiedError, faults.ObjectLostError)
        yield Cluster(workers, wanted.gpus, lambda: executor, (*lost, faults.OutOfMemoryError))
    finally:
        ray.shutdown()


def _ray_workers(free: Mapping[str, float], wanted: Resources) -> int:
    """Tasks that can run at once."""
    room = int(free.get("CPU", 0.0) / wanted.cores)
    if wanted.gpus:
        room = min(room, int(free.get("GPU", 0.0) / wanted.gpus))
    if room < 1:
        listed = ", ".join(f"{name} {free.get(name, 0.0):g}" for name in ("CPU", "GPU"))
        raise ClusterError(
            f"no worker with {wanted.cores} cores and {wanted.gpus:g} GPUs fits the cluster "
            f"({listed}); ask for less with --cores-per-worker and --gpus-per-worker"
        )
    return min(wanted.workers or room, room)


@contextmanager
def _dask_cluster(address: str | None, wanted: Resources) -> Iterator[Cluster]:
    """A running cluster of Dask, or one that is started here with one thread in each worker."""
    distributed = load("distributed", "dask")
    started = None
    if address is None:
        started = distributed.LocalCluster(
            n_workers=wanted.local_workers,
            threads_per_worker=1,
            processes=True,
            dashboard_address=None,
            scheduler_kwargs={"dashboard_address": "127.0.0.1:0"},
            silence_logs=logging.ERROR,
        )
    try:
        client = distributed.Client(started or address, timeout="30s")
    except OSError as error:
        raise ClusterError(
            f"no scheduler of Dask answers at {address}: {error}; start one with `dask scheduler`, "
            "or leave out --address"
        ) from None
    try:
        found = len(client.scheduler_info(n_workers=-1)["workers"])
        asked = {"resources": {"GPU": wanted.gpus}} if wanted.gpus else {}
        executor = client.get_executor(pure=False, **asked)
        workers, lost = wanted.workers or max(1, found), (distributed.KilledWorker,)
        yield Cluster(workers, wanted.gpus, lambda: executor, lost)
    finally:
        client.close()
        if started is not None:
            started.close()


class SlurmExecutor(ThreadPoolExecutor):
    """Jobs of Slurm as futures, a job for each task, at most so many at once.

    Args:
        submit: of submitit: gives a job.
        workers: jobs at once.
    """

    def __init__(self, submit: Callable[..., Any], workers: int) -> None:
        super().__init__(workers)
        self._submit_job = submit
        self._one_by_one = threading.Lock()
        self._stopped = threading.Event()

    def submit(self, task: Callable[..., Any], /, *given: Any, **named: Any) -> Future[Any]:
        """Have a task run."""
        return super().submit(self._run_job, task, given, named)

    def stop(self) -> None:
        """Cancel all jobs, and start no others."""
        self._stopped.set()
        self.shutdown(wait=True, cancel_futures=True)

    def _run_job(self, *task: Any) -> Any:
        with self._one_by_one:
            job = self._submit_job(_result_or_error, *task)
        while not job.done():
            if self._stopped.wait(POLL_SECONDS):
                job.cancel()
                raise BrokenExecutor("cancelled")
        result, error = job.result()
        if error is not None:
            raise error
        return result


def _result_or_error(*task: Any) -> tuple[Any, Exception | None]:
    """What a task returns, or the error that it raises, as it was."""
    try:
        return _call_with(*task), None
    except Exception as error:
        return None, error


def _load_submitit() -> Any:
    """The module, imported without its logging set-up, which closes the process's own handlers."""
    level = "SUBMITIT_LOG_LEVEL"
    before = os.environ.get(level)
    os.environ[level] = before or "NOCONFIG"
    try:
        return load("submitit", "slurm")
    finally:
        if before is None:
            del os.environ[level]


@contextmanager
def _slurm_cluster(address: str | None, wanted: Resources) -> Iterator[Cluster]:
    """Jobs of Slurm through submitit, whose files lie in the working directory meanwhile."""
    submitit = _load_submitit()
    if address not in (None, "local"):
        raise ClusterError(
            f"Slurm has no address, and --address local runs its jobs here; got {address!r}"
        )
    if wanted.workers is None:
        raise ClusterError("say how many jobs of Slurm may run at once: --workers N")
    options: dict[str, Any] = {"cpus_per_task": wanted.cores, "timeout_min": JOB_MINUTES}
    if wanted.gpus:
        options["gpus_per_node"] = int(wanted.gpus)
    if wanted.memory_gib is not None:
        options["mem_gb"] = wanted.memory_gib / wanted.workers
    with TemporaryDirectory(
        prefix=".integ-gym-slurm-", dir=Path.cwd(), ignore_cleanup_errors=True
    ) as folder:
        try:
            jobs = submitit.AutoExecutor(folder=folder, cluster=address or "slurm")
        except RuntimeError as error:
            raise ClusterError(
                f"no Slurm answers here: {error}; run this where `sbatch` is, or give another "
                "--executor"
            ) from None
        jobs.update_parameters(name="integ-gym", **options)
        executor = SlurmExecutor(jobs.submit, wanted.workers)
        try:
            lost = (submitit.core.utils.UncompletedJobError,)
            yield Cluster(wanted.workers, wanted.gpus, lambda: executor, lost)
        finally:
            executor.stop()


_ENGINES = {"ray": _ray_cluster, "dask": _dask_cluster, "slurm": _slurm_cluster}
