"""Tasks on Ray, which has no `concurrent.futures.Executor` of its own."""

from __future__ import annotations

import logging
import os
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from contextlib import contextmanager
from typing import Any

from ..packages.extras import load
from .resources import ClusterError, Resources

RETRIES = 5
"""How often a task whose node or process was lost is run again."""


class RayExecutor(Executor):
    """Core tasks of Ray as futures.

    Args:
        ray: the module, connected to a cluster.
        options: of every task.
    """

    def __init__(self, ray: Any, options: dict[str, Any]) -> None:
        self._ray = ray
        self._run = ray.remote(_run).options(**options)

    def submit(self, task: Callable[..., Any], /, *given: Any, **named: Any) -> Future[Any]:
        """Have a task run."""
        found: Future[Any] = self._run.remote(task, given, named).future()
        return found


def _run(task: Callable[..., Any], given: tuple[Any, ...], named: dict[str, Any]) -> Any:
    return task(*given, **named)


@contextmanager
def ray_cluster(address: str | None, wanted: Resources) -> Iterator[tuple[int, Executor]]:
    """Workers and executor of a running cluster, or of one that is started here."""
    ray = load("ray", "ray")
    own = {} if address else _of_this_machine(wanted)
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
        workers = _workers(ray.cluster_resources(), wanted)
        yield workers, RayExecutor(ray, _options(wanted, workers))
    finally:
        ray.shutdown()


def _of_this_machine(wanted: Resources) -> dict[str, Any]:
    """How a cluster is started here, whose processes find the modules that this one does."""
    paths = {"PYTHONPATH": os.pathsep.join(sys.path)}
    cpus = wanted.here * wanted.cores
    return {"num_cpus": cpus, "include_dashboard": False, "runtime_env": {"env_vars": paths}}


def _options(wanted: Resources, workers: int) -> dict[str, Any]:
    """Of a task: what it takes on its node, and that it is run again where that was lost."""
    asked = {"num_cpus": wanted.cores, "num_gpus": wanted.gpus, "max_retries": RETRIES}
    if wanted.memory_gib is not None:
        asked["memory"] = int(wanted.memory_gib * 2**30 / workers)
    return asked


def _workers(there: dict[str, float], wanted: Resources) -> int:
    """Tasks that can run at once."""
    room = int(there.get("CPU", 0.0) / wanted.cores)
    if wanted.gpus:
        room = min(room, int(there.get("GPU", 0.0) / wanted.gpus))
    if room < 1:
        told = ", ".join(f"{name} {there.get(name, 0.0):g}" for name in ("CPU", "GPU"))
        raise ClusterError(
            f"no worker with {wanted.cores} cores and {wanted.gpus:g} GPUs fits the cluster "
            f"({told}); ask for less with --cores-per-worker and --gpus-per-worker"
        )
    return min(wanted.workers or room, room)
