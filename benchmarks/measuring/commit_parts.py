"""What committing a batch of traced episodes takes, part by part, and what files take at least."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow.feather
import pyarrow.parquet

from integ_gym.evidence.hashing import content_hashes
from integ_gym.evidence.parquet_file import write
from integ_gym.evidence.schema import is_trace

FEWEST = 5


class Part(NamedTuple):
    """Some work on the same episodes, in one thread."""

    name: str
    does: Callable[[], Any]
    serves: bool
    """Whether a commit does it; the others show what it could not go below."""


def commit_parts(
    plain: Callable[[], Any],
    recorded: Callable[[], Any],
    recorder: Any,
    directory: Path,
    seconds: float,
) -> dict[str, Any]:
    """Median times of the parts, which take turns.

    Args:
        plain: plays episodes in lanes.
        recorded: the same with a recorder.
        recorder: of those, with a trace of each.
        directory: where files are written.
        seconds: time in all.

    Returns:
        Number of episodes, bytes of their trace columns, and by part ``seconds`` and ``serves``.
    """
    recorded()
    table = recorder.take()
    traces = _traces(table)
    parts = list(_parts(plain, recorded, recorder, table, traces, directory))
    found: dict[str, list[float]] = {part.name: [] for part in parts}
    end = time.perf_counter() + seconds
    while len(found[parts[0].name]) < FEWEST or time.perf_counter() < end:
        for part in parts:
            start = time.perf_counter()
            part.does()
            found[part.name].append(time.perf_counter() - start)
    return {
        "episodes": table.num_rows,
        "trace_bytes": traces.nbytes,
        "parts": {
            part.name: {"seconds": float(np.median(found[part.name])), "serves": part.serves}
            for part in parts
        },
    }


def _traces(table: Any) -> Any:
    """The trace columns that hold numbers."""
    names = [name for name in table.column_names if is_trace(name)]
    return table.select([name for name in names if table[name].null_count < table.num_rows])


def _parts(
    plain: Callable[[], Any],
    recorded: Callable[[], Any],
    recorder: Any,
    table: Any,
    traces: Any,
    directory: Path,
) -> Iterator[Part]:
    file = directory / "written"
    numbers = bytes(traces.nbytes)
    yield Part("episodes played without evidence", plain, False)
    yield Part("the same recorded, gathered and summarised", recorded, True)
    yield Part("made records, with content hashes", recorder.take, True)
    yield Part("content hashes alone", lambda: content_hashes(table), False)
    yield Part("Parquet file, as stored", lambda: write([table], file), True)
    yield Part("traces as SHA-256", lambda: hashlib.sha256(numbers).digest(), False)
    yield Part(
        "traces as Parquet, neither encoded nor compressed",
        lambda: pyarrow.parquet.write_table(
            traces, file, compression="none", use_dictionary=False, write_statistics=False
        ),
        False,
    )
    yield Part(
        "traces as Arrow's own file, not compressed",
        lambda: pyarrow.feather.write_feather(traces, file, compression="uncompressed"),
        False,
    )
    yield Part("traces as bytes", lambda: file.write_bytes(numbers), False)
