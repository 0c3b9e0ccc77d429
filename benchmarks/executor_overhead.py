"""What an engine takes beside the work: the same units on each, over processes of this machine.

    python benchmarks/executor_overhead.py [--seconds 60] [--units 4] [--json FILE]

Every unit computes for so many seconds by the clock, so that what is over is the engine's: its
start, which comes once, and for each unit sending it, sending its result back and writing it. How
much was computed in a second of processor time is printed as well, beside what the local pool
computed: an engine that takes from the work shows there. Run it on an idle machine.
"""

from __future__ import annotations

import argparse
import shutil
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from measuring import results
from tqdm import tqdm

from integ_gym.support.executors import Resources, TaskPool, open_cluster
from integ_gym.support.files import write_files, write_once
from integ_gym.support.processes import Progress

EXAMPLES = """\
examples:
  python benchmarks/executor_overhead.py                     9 minutes
  python benchmarks/executor_overhead.py --only local dask --seconds 5
"""

EXECUTORS = ("local", "dask", "ray", "executor_overhead:two_processes")
SIZE = 64
"""Of the square matrices whose products are the work."""

RESULT = 1_000_000
"""Bytes that each unit leaves behind."""

PACKAGES = ("integ-gym", "dask", "distributed", "ray", "numpy")


def two_processes() -> Any:
    """An executor as a module of one's own may give it."""
    from concurrent.futures import ProcessPoolExecutor
    from multiprocessing import get_context

    return ProcessPoolExecutor(2, mp_context=get_context("spawn"))


def compute(seconds: float) -> float:
    """Work for so long by the clock; products of matrices in a second of processor time."""
    matrix = np.random.default_rng(0).standard_normal((SIZE, SIZE)) / SIZE
    begun, used, products = time.perf_counter(), time.process_time(), 0
    while time.perf_counter() - begun < seconds:
        for _ in range(100):
            matrix = matrix @ matrix
        products += 100
    return products / (time.process_time() - used)


def here(run: str, unit: str, seconds: float) -> float:
    """A unit of a local pool, which writes where its result belongs."""
    rate = compute(seconds)
    file = Path(run) / "evidence" / f"{unit}.parquet"
    write_once(file, lambda path: path.write_bytes(bytes(RESULT)))
    return rate


def elsewhere(run: str, unit: str, seconds: float) -> tuple[float, bytes]:
    """A unit of another executor, which returns what it writes."""
    return compute(seconds), bytes(RESULT)


def nothing(number: int) -> None:
    """A task that waits for a worker to be there."""
    time.sleep(0.5)


class _NoBar:
    """A bar that shows nothing."""

    n = 0.0

    def update(self, amount: float) -> None:
        """Nothing."""


def measured(executor: str, given: argparse.Namespace) -> dict[str, float]:
    """Seconds until workers are there, seconds of all units, and the rate of the work."""
    run = Path(tempfile.mkdtemp())
    try:
        (run / "evidence").mkdir()
        begun = time.perf_counter()
        with open_cluster(executor, resources=Resources(given.workers)) as cluster:
            task = elsewhere if cluster.remote else here
            with TaskPool(cluster, Progress(_NoBar())) as pool:
                dict(pool.run({n: (nothing, n) for n in range(2 * given.workers)}))
                started = time.perf_counter()
                units = [f"unit-{number}" for number in range(given.units)]
                rates = []
                for unit, future in pool.run(
                    {u: (task, str(run), u, given.seconds) for u in units}
                ):
                    rate = future.result()
                    if cluster.remote:
                        rate, result = rate
                        write_files(run / "evidence", {f"{unit}.parquet": result})
                    rates.append(rate)
                ended = time.perf_counter()
        if len(list((run / "evidence").glob("*.parquet"))) != given.units:
            raise RuntimeError(f"{executor} lost units")
        return {
            "start_seconds": started - begun,
            "unit_seconds": ended - started,
            "products_per_second": float(np.mean(rates)),
        }
    finally:
        shutil.rmtree(run)


def main() -> None:
    """Print the table; write JSON where asked."""
    parser = results.parser(__doc__, EXAMPLES, file=True)
    add = parser.add_argument
    add("--only", nargs="+", default=list(EXECUTORS), metavar="EXECUTOR")
    add("--seconds", type=float, default=60.0, metavar="S", help="of each unit (default: 60)")
    add("--units", type=int, default=4, metavar="N", help="(default: 4)")
    add("--workers", type=int, default=2, metavar="N", help="(default: 2)")
    given = parser.parse_args()
    found = {}
    for executor in tqdm(given.only, unit="engine"):
        found[executor] = measured(executor, given)
        results.write(given.json, {"executors": found}, PACKAGES)
    least = given.seconds * -(-given.units // given.workers)
    first = next(iter(found.values()))
    rows = [
        [
            executor,
            f"{one['start_seconds']:.1f}",
            f"{one['unit_seconds']:.2f}",
            f"{one['unit_seconds'] / first['unit_seconds'] - 1.0:+.2%}",
            f"{one['unit_seconds'] / least - 1.0:+.2%}",
            f"{one['products_per_second'] / first['products_per_second']:.2f}",
        ]
        for executor, one in found.items()
    ]
    name = f"over {next(iter(found))}"
    results.print_table(
        ("executor", "start, s", "units, s", name, "over the work alone", "work per CPU second"),
        rows,
    )


if __name__ == "__main__":
    main()
