"""Engines that run tasks: processes of this machine, Ray, Dask, or an executor of one's own."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from importlib import import_module
from typing import Protocol

from ..processes.workers import Progress, cores
from .remote import RemoteExecutor
from .resources import ClusterError, Resources

EXECUTORS = ("local", "ray", "dask")
"""Engines by name; ``"module:function"`` is any other."""


class Cluster(Protocol):
    """An engine that is there."""

    @property
    def workers(self) -> int:
        """Processes that it can have at work at once."""
        ...

    @property
    def gpus(self) -> float:
        """That each of them was asked for with."""
        ...

    @property
    def remote(self) -> bool:
        """Whether it may be on other machines, and run tasks again where it lost one."""
        ...

    def pool(
        self, progress: Progress, prepare: Callable[[int], None] | None = None
    ) -> AbstractContextManager[Executor]:
        """What runs tasks; an error that leaves the block cancels what waits.

        Args:
            progress: is told of the work that tasks report.
            prepare: called once in each process before its first task, with its number where the
                engine numbers them, else 0; importable from a module.
        """
        ...


@dataclass(frozen=True)
class Local:
    """Processes of this machine, started for each pool and ended with it.

    Attributes:
        workers: processes.
        gpus: none is asked for.
    """

    workers: int
    gpus: float = 0
    remote: bool = False

    def pool(
        self, progress: Progress, prepare: Callable[[int], None] | None = None
    ) -> AbstractContextManager[Executor]:
        """See :class:`Cluster`."""
        return progress.pool(self.workers, prepare)


@dataclass(frozen=True)
class Remote:
    """An engine of others, whose processes stay from task to task.

    Attributes:
        workers: processes.
        executor: gives tasks to it.
        gpus: of each worker.
    """

    workers: int
    executor: Executor
    gpus: float = 0
    remote: bool = True

    @contextmanager
    def pool(
        self, progress: Progress, prepare: Callable[[int], None] | None = None
    ) -> Iterator[Executor]:
        """See :class:`Cluster`."""
        executor = RemoteExecutor(self.executor, progress, prepare)
        try:
            yield executor
        except BaseException:
            executor.cancel()
            raise


@contextmanager
def cluster_of(
    executor: str = "local", address: str | None = None, resources: Resources | None = None
) -> Iterator[Cluster]:
    """An engine by name, for as long as the block lasts; what was started for it ends with it.

    Args:
        executor: one of :data:`EXECUTORS`, or ``"module:function"``: a function without arguments
            that returns a `concurrent.futures.Executor` of processes.
        address: of a running cluster of Ray or Dask; by default one is started on this machine.
        resources: what is asked for.

    Raises:
        ClusterError: for one that cannot be used.
        ModuleNotFoundError: if its extra is missing, with the command that installs it.
    """
    wanted = resources or Resources()
    if address is not None and executor not in ("ray", "dask"):
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
        yield Local(wanted.here)
        return
    with _opened(executor, address, wanted) as (workers, running):
        yield Remote(workers, running, wanted.gpus)


def _opened(
    executor: str, address: str | None, wanted: Resources
) -> AbstractContextManager[tuple[int, Executor]]:
    if executor == "ray":
        from .on_ray import ray_cluster

        return ray_cluster(address, wanted)
    if executor == "dask":
        from .on_dask import dask_cluster

        return dask_cluster(address, wanted)
    if ":" not in executor:
        raise ClusterError(
            f'--executor must be one of {", ".join(EXECUTORS)}, or "module:function" for an '
            f"executor of your own, got {executor!r}"
        )
    return _own(executor, wanted)


@contextmanager
def _own(reference: str, wanted: Resources) -> Iterator[tuple[int, Executor]]:
    """What a function of the user's own gives."""
    module, _, name = reference.partition(":")
    if wanted.cores != 1:
        raise ClusterError(
            f"{reference!r} decides itself how many cores its processes have; leave "
            "--cores-per-worker out"
        )
    try:
        made = getattr(import_module(module), name)()
    except Exception as error:  # whatever the user's function does
        raise ClusterError(
            f"cannot get an executor from {reference!r}: {type(error).__name__}: {error}; write it "
            'as "module:function", importable from here and called without arguments'
        ) from error
    if not callable(getattr(made, "submit", None)):
        raise ClusterError(
            f"{reference!r} gives {type(made).__name__}, which is no executor: it needs "
            "`submit`, as concurrent.futures.Executor has"
        )
    told = getattr(made, "_max_workers", None)
    try:
        yield wanted.workers or (told if isinstance(told, int) else cores()), made
    finally:
        made.shutdown(wait=True, cancel_futures=True)
