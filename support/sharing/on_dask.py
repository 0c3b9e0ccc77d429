"""Tasks on Dask."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from typing import Any

from ..packages.extras import load
from .resources import ClusterError, Resources

RETRIES = 5
"""How often a task whose worker was lost is run again."""


@contextmanager
def dask_cluster(address: str | None, wanted: Resources) -> Iterator[tuple[int, Executor]]:
    """Workers and executor of a running cluster, or of one that is started here.

    A worker that is started here has one thread; on a running cluster one unit is done at a time in
    each process, whatever its threads.
    """
    distributed = load("distributed", "dask")
    started = None
    if address is None:
        started = distributed.LocalCluster(
            n_workers=wanted.here,
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
        yield _workers(client, wanted), _executor(client, wanted)
    finally:
        client.close()
        if started is not None:
            started.close()


def _executor(client: Any, wanted: Resources) -> Any:
    """Of one process each, with a GPU where one is asked for; see Dask's "worker resources"."""
    named = {"resources": {"GPU": wanted.gpus}} if wanted.gpus else {}
    return client.get_executor(pure=False, retries=RETRIES, **named)


def _workers(client: Any, wanted: Resources) -> int:
    found = len(client.scheduler_info(n_workers=-1)["workers"])
    return wanted.workers or max(1, found)
