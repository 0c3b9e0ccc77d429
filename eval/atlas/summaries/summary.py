"""The outcome of a block: one row per policy and cell, with all that pins the run it came from."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from integ_gym.evidence.sealing import read_seal
from integ_gym.evidence.store import open_run
from integ_gym.support.files import read_bounded, replace_file
from integ_gym.support.optional import package_version

from ...panel.model.files import FILE_NAME, read_panel
from ..specification import Block
from .code_version import code_version

KEY = b"integ-gym atlas"
"""Of the description in the file's metadata."""

LARGEST = 8 << 20
"""Bytes of a summary, at most."""

PACKAGES = ("integ-gym", "numpy", "jax", "jaxlib")
"""Whose versions are told."""

_OUTCOMES = """
SELECT policy_id, policy_hash, training_seed::UINTEGER AS seed, cell,
       count(*)::UTINYINT AS episodes,
       (count(*) FILTER (success))::UTINYINT AS successes,
       (count(*) FILTER (success OR coalesce(replay_second_horizon, FALSE)))::UTINYINT AS recovered,
       avg("return")::FLOAT AS mean_return,
       avg(arrival_energy)::FLOAT AS arrival_energy,
       avg(arrival_residual)::FLOAT AS arrival_residual
FROM records WHERE phase = 'evaluation' AND training_seed IS NOT NULL
GROUP BY ALL ORDER BY policy_id, cell
"""


class Origin(msgspec.Struct, frozen=True, kw_only=True):
    """Where a summary comes from.

    Attributes:
        atlas: name of the atlas.
        ratio: limit of the control over the critical one.
        limit: limit of the control, N m or N.
        seal: of the run.
        weights: hash of all policies' hashes.
        code: version of the code, see :func:`code_version`.
        versions: of the packages that matter.
        instruction_sets: of the processor; empty: not known.
        specification: of the panel, everything resolved.
        cost: core time of training and evaluation, s.
    """

    atlas: str
    ratio: float
    limit: float
    seal: str
    weights: str
    code: str
    versions: dict[str, str | None]
    specification: dict[str, Any]
    cost: dict[str, float]
    instruction_sets: tuple[str, ...] = ()


@dataclass(frozen=True)
class Summary:
    """A block's outcomes.

    Attributes:
        origin: where they come from.
        rows: Arrow table: home, seed, cell, episodes, successes, recovered (within one horizon or
            two), mean_return, arrival_energy (gained up to the goal, J), arrival_residual (of it
            what numerical error put in, J), policy_hash.
    """

    origin: Origin
    rows: Any


def summarize(run: Path, atlas: str, block: Block) -> Summary:
    """The summary of a block's finished run.

    Args:
        run: its directory.
        atlas: name of the atlas.
        block: what was run.
    """
    import pyarrow as pa

    panel, sealed = read_panel(run / FILE_NAME), read_seal(run)
    assert sealed is not None
    assert panel.cost is not None
    found = open_run(run).query(_OUTCOMES)
    rows = {policy.id: row.name for row in panel.rows for policy in row.policies}
    homes = pa.array([rows[policy] for policy in found["policy_id"].to_pylist()])
    hashes = pa.array([bytes.fromhex(one) for one in found["policy_hash"].to_pylist()])
    table = found.drop_columns(["policy_id", "policy_hash"])
    table = table.add_column(0, "home", homes).append_column("policy_hash", hashes)
    versions = {name: package_version(name) for name in PACKAGES}
    origin = Origin(
        atlas=atlas,
        ratio=block.ratio,
        limit=block.limit,
        seal=str(sealed["seal"]),
        weights=panel.weights,
        code=code_version(),
        versions=versions,
        specification=block.panel.to_json(),
        cost={"train": panel.cost.train_seconds, "evaluate": panel.cost.evaluate_seconds},
        instruction_sets=panel.instruction_sets,
    )
    return Summary(origin, table)


def write_summary(summary: Summary, path: Path) -> Path:
    """Write a summary as Parquet, whole or not at all."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    told = msgspec.json.encode(summary.origin)
    sink = pa.BufferOutputStream()
    table = summary.rows.replace_schema_metadata({KEY: told})
    pq.write_table(table, sink, compression="zstd", compression_level=19)
    return replace_file(path, sink.getvalue().to_pybytes())


def read_summary(path: Path) -> Summary:
    """Read a summary.

    Raises:
        ValueError: if it is none, in one sentence.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        # A thread of Arrow's that lets go of the buffer while Python ends would abort the process.
        source = pa.BufferReader(read_bounded(path, LARGEST))
        table = pq.ParquetFile(source, pre_buffer=False).read(use_threads=False)
        origin = msgspec.json.decode((table.schema.metadata or {})[KEY], type=Origin)
    except (KeyError, msgspec.DecodeError, pa.ArrowException) as error:
        raise ValueError(f"{path} is no summary of an atlas's block: {error}") from None
    return Summary(origin, table.replace_schema_metadata(None))
