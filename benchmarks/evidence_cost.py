"""What evidence costs: time while recording, time and bytes when written, time of queries.

    python benchmarks/evidence_cost.py [--seconds 4.0] [--episodes 1000000]
                                       [--only recording parts store] [--json FILE]

Recording: an environment and the same one recorded take turns, with traces of all episodes and with
summaries alone; what was recorded is written in batches. `recording` is the rate while recording,
`in all` with the writing, both as shares of the rate without evidence, which is `steps/s`.
Parts: what recording and committing many lanes' episodes takes, one piece of work after the other,
and what SHA-256 and files of the same numbers take that hold nothing else.
Queries run over a store of that many summaries, made from a few thousand recorded ones under new
ids.
"""

from __future__ import annotations

import hashlib
import multiprocessing
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.feather
import pyarrow.parquet
from bounds import print_judged
from measuring import results
from measuring.rates import TURN, single, vector

import integ_gym  # noqa: F401
from integ_gym.evidence.hashing import content_hashes
from integ_gym.evidence.labels import EpisodeContext
from integ_gym.evidence.parquet_file import write
from integ_gym.evidence.recorder import RecordEvidence
from integ_gym.evidence.schema import is_trace
from integ_gym.evidence.store import EvidenceStore
from integ_gym.evidence.vector_recorder import RecordVectorEvidence
from integ_gym.support.processes import peak_memory

ENVIRONMENTS = ("IntegPendulum-v0", "IntegCartPole-v0")
LANES = (1, 64, 1024)
SUMMARIES_ONLY = 1_000_000_000
EPISODES_PER_BATCH = 256
"""Episodes of the pendulum that are written at once, at least; of the cart-pole it is more."""

FEWEST, FEWEST_PARTS = 3, 5
"""Batches, and turns of the parts of a commit."""

ROWS_PER_FILE = 50_000
BASE_RECORDS = 4096
PACKAGES = ("integ-gym", "gymnasium", "numpy", "pyarrow", "duckdb")

QUERIES = {
    "how many": "SELECT count(*) AS n FROM records",
    "success by cell": (
        "SELECT cell, avg(success::INT) AS success, median(energy_residual_total) AS residual "
        "FROM records GROUP BY cell ORDER BY cell"
    ),
    "failures by label": (
        'SELECT failure_label, count(*) AS n, avg("return") AS r FROM records '
        "WHERE NOT success GROUP BY failure_label ORDER BY n DESC"
    ),
    "worst residuals": (
        "SELECT record_id, failure_reason FROM records "
        "ORDER BY abs(energy_residual_total) DESC LIMIT 10"
    ),
}


def recording_cost(environment: str, lanes: int, trace: bool, seconds: float) -> dict[str, Any]:
    """Steps per second of one environment without evidence, shares of that with it, and sizes."""
    clocks: dict[str, list[float]] = {"plain": [], "recorded": [], "written": []}
    turns = max(1, EPISODES_PER_BATCH // lanes)
    with tempfile.TemporaryDirectory() as directory:
        plain, recorded, recorder = _contenders(environment, lanes, trace, directory)
        for warm_up in (plain, recorded, lambda: recorder.commit("warm-up").unlink()):
            warm_up()
        end = time.perf_counter() + seconds
        while len(clocks["plain"]) < FEWEST or time.perf_counter() < end:
            name = f"batch-{len(clocks['plain'])}"
            both = [(_seconds(plain), _seconds(recorded)) for _ in range(turns)]
            for one, times in zip(("plain", "recorded"), zip(*both, strict=True), strict=True):
                clocks[one].append(sum(times))
            clocks["written"].append(_seconds(partial(recorder.commit, name)))
        store = EvidenceStore(directory)
        size = sum(file.stat().st_size for file in store.files())
        lengths = [record["length"] for record in store.records(trace=False)]
    plain_s, recorded_s, written_s = (float(np.median(clocks[name])) for name in clocks)
    return {
        "environment": environment,
        "lanes": lanes,
        "trace": trace,
        "steps_per_second": turns * TURN * lanes / plain_s,
        "recording": plain_s / recorded_s,
        "in_all": plain_s / (recorded_s + written_s),
        "records_per_second": len(lengths) / len(clocks["plain"]) / written_s,
        "bytes_per_record": size / len(lengths),
        "bytes_per_step": size / sum(lengths),
    }


def _contenders(
    environment: str, lanes: int, trace: bool, directory: str
) -> tuple[Callable[[], int], Callable[[], int], Any]:
    """A turn of the environment, one of the same recorded, and its recorder."""
    context = EpisodeContext(
        "benchmark", "cell", phase="training", trace_every=1 if trace else SUMMARIES_ONLY
    )
    if lanes == 1:
        recorder: Any = RecordEvidence(
            gym.make(environment), directory, context, commit_on_close=False
        )
        return single(gym.make(environment)), single(recorder), recorder
    plain, inner = (gym.make_vec(environment, num_envs=lanes, compiled=False) for _ in range(2))
    recorder = RecordVectorEvidence(inner, directory, context, commit_on_close=False)
    return vector(plain, lanes), vector(recorder, lanes), recorder


def store_cost(episodes: int) -> dict[str, Any]:
    """What a store of so many summaries costs: writing, bytes, queries, and the most memory."""
    with tempfile.TemporaryDirectory() as directory:
        size, rate = fill_store(Path(directory), episodes)
        queries = list(query_times(Path(directory)))
    return {
        "episodes": episodes,
        "bytes_per_summary": size,
        "written_per_second": rate,
        "queries": queries,
        "most_memory": peak_memory(),
    }


def fill_store(directory: Path, episodes: int) -> tuple[float, float]:
    """Write so many summaries to a store; bytes per record, and records per second."""
    context = EpisodeContext("benchmark", "cell", phase="training", trace_every=SUMMARIES_ONLY)
    environment = gym.make_vec("IntegCartPole-v0", num_envs=64)
    recorder = RecordVectorEvidence(environment, directory, context, commit_on_close=False)
    advance = vector(recorder, 64)
    while len(recorder.summaries()["episode_index"]) < BASE_RECORDS:
        advance()
    base = recorder.take()
    store, seconds = EvidenceStore(directory), 0.0
    for number, first in enumerate(range(0, episodes, ROWS_PER_FILE)):
        count = min(ROWS_PER_FILE, episodes - first)
        places = np.arange(count) % base.num_rows
        table = _under_new_ids(base.take(places), first)
        seconds += _seconds(partial(store.commit, f"part-{number:05d}", table))
    return sum(file.stat().st_size for file in store.files()) / episodes, episodes / seconds


def _under_new_ids(table: Any, first: int) -> Any:
    """The rows as other episodes, in ten cells."""
    indices = np.arange(first, first + table.num_rows)
    changed = {
        "record_id": pc.binary_join_element_wise(
            pc.utf8_slice_codeunits(table["record_id"], 0, 16),
            pa.array([f"{index:016x}" for index in indices]),
            "",
        ),
        "episode_index": pa.array(indices),
        "cell": pa.array([f"cell-{index % 10}" for index in indices]),
    }
    for name, column in changed.items():
        place = table.schema.get_field_index(name)
        table = table.set_column(place, table.schema.field(name), column)
    return table


def query_times(directory: Path, repeats: int = 3) -> Iterator[dict[str, Any]]:
    """Seconds of each query in this process, and of the whole command."""
    store = EvidenceStore(directory)
    for name, sql in QUERIES.items():
        inside = min(_seconds(partial(store.query, sql)) for _ in range(repeats))
        command = [sys.executable, "-m", "integ_gym.cli", "evidence", "query", str(directory), sql]
        run = partial(subprocess.run, command, check=True, stdout=subprocess.DEVNULL)
        whole = min(_seconds(run) for _ in range(repeats))
        yield {"query": name, "sql": sql, "seconds": inside, "command_seconds": whole}


def _seconds(function: Callable[[], Any]) -> float:
    start = time.perf_counter()
    function()
    return time.perf_counter() - start


def commit_parts(seconds: float) -> dict[str, Any]:
    """Median times of the parts of committing a batch of traced episodes, which take turns.

    Beside them is what files take at least: of each part it is said whether a commit does it.
    """
    environment, lanes = ENVIRONMENTS[0], LANES[-1]
    with tempfile.TemporaryDirectory() as directory:
        plain, recorded, recorder = _contenders(environment, lanes, True, directory)
        recorded()
        table, file = recorder.take(), Path(directory) / "written"
        names = [name for name in table.column_names if is_trace(name)]
        numbers = [name for name in names if table[name].null_count < table.num_rows]
        traces = table.select(numbers)
        content = bytes(traces.nbytes)
        parts: dict[str, tuple[Callable[[], Any], bool]] = {
            "episodes played without evidence": (plain, False),
            "the same recorded, gathered and summarised": (recorded, True),
            "made records, with content hashes": (recorder.take, True),
            "content hashes alone": (lambda: content_hashes(table), False),
            "Parquet file, as stored": (lambda: write([table], file), True),
            "traces as SHA-256": (lambda: hashlib.sha256(content).digest(), False),
            "traces as Parquet, neither encoded nor compressed": (
                lambda: pyarrow.parquet.write_table(
                    traces, file, compression="none", use_dictionary=False, write_statistics=False
                ),
                False,
            ),
            "traces as Arrow's own file, not compressed": (
                lambda: pyarrow.feather.write_feather(traces, file, compression="uncompressed"),
                False,
            ),
            "traces as bytes": (lambda: file.write_bytes(content), False),
        }
        found: dict[str, list[float]] = {name: [] for name in parts}
        end = time.perf_counter() + seconds
        while len(found["traces as bytes"]) < FEWEST_PARTS or time.perf_counter() < end:
            for name, (work, _) in parts.items():
                found[name].append(_seconds(work))
    medians = {name: float(np.median(times)) for name, times in found.items()}
    return {
        "environment": environment,
        "lanes": lanes,
        "episodes": table.num_rows,
        "trace_bytes": traces.nbytes,
        "parts": {n: {"seconds": medians[n], "serves": serves} for n, (_, serves) in parts.items()},
    }


def main() -> None:
    """Print the tables; write JSON where asked."""
    kinds = ("recording", "parts", "store")
    parser = results.parser(__doc__, file=True)
    parser.add_argument("--seconds", type=float, default=4.0, help="time per recorded row, s")
    parser.add_argument("--episodes", type=int, default=1_000_000, help="to be queried")
    parser.add_argument("--only", nargs="+", choices=kinds, default=kinds, help="some of these")
    given = parser.parse_args()
    content: dict[str, Any] = {}
    if "recording" in given.only:
        content["recording"] = [
            recording_cost(environment, lanes, trace, given.seconds)
            for environment, lanes, trace in product(ENVIRONMENTS, LANES, (True, False))
        ]
        results.print_table(RECORDING, map(_cells, content["recording"]))
    if "parts" in given.only:
        content["parts"] = found = commit_parts(given.seconds)
        print(
            f"\n{found['episodes']} episodes of {found['environment']}, played together; "
            f"{found['trace_bytes'] / 2**20:.0f} MiB of traces"
        )
        rows = (
            (name, f"{1e3 * part['seconds']:.1f}", "yes" if part["serves"] else "")
            for name, part in found["parts"].items()
        )
        results.print_table(("work, in one thread", "ms", "part of a commit"), rows)
    if "store" in given.only:
        with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
            content |= pool.submit(store_cost, given.episodes).result()
        print(
            f"\n{content['episodes']:,} episodes, {content['bytes_per_summary']:.0f} bytes each, "
            f"{content['written_per_second']:,.0f} written a second; most memory "
            f"{content['most_memory'] / 2**20:.0f} MiB"
        )
        rows = (
            (q["query"], f"{1e3 * q['seconds']:.0f}", f"{1e3 * q['command_seconds']:.0f}")
            for q in content["queries"]
        )
        results.print_table(("query", "store, ms", "command, ms"), rows)
    print_judged("evidence_cost", content)
    results.write(given.json, content, PACKAGES)


RECORDING = (
    "environment", "lanes", "traces", "steps/s", "recording", "in all", "records/s",
    "bytes/record", "bytes/step",
)  # fmt: skip


def _cells(cost: dict[str, Any]) -> list[str]:
    return [
        cost["environment"], str(cost["lanes"]), "all" if cost["trace"] else "none",
        f"{cost['steps_per_second']:,.0f}", f"{cost['recording']:.2f}", f"{cost['in_all']:.2f}",
        f"{cost['records_per_second']:,.0f}", f"{cost['bytes_per_record']:,.0f}",
        f"{cost['bytes_per_step']:.1f}",
    ]  # fmt: skip


if __name__ == "__main__":
    main()
