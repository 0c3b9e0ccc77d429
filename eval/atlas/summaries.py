"""What an atlas publishes of each panel, and whether two of them agree."""

from __future__ import annotations

import ast
import hashlib
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from pathlib import Path
from statistics import fmean
from typing import Any

import msgspec
import numpy as np
import numpy.typing as npt

from integ_gym.evidence.sealing import read_seal
from integ_gym.evidence.store import open_run
from integ_gym.support.errors import InputError
from integ_gym.support.files import read_bounded, replace_file
from integ_gym.support.optional import package_version

from ..panel.cells import Home
from ..panel.result import FILE_NAME, read_panel
from ..statistics import mean_interval
from ..verdict import LEARNED
from .specification import Atlas, Block

ROOMS = ("support", "envs", "evidence", "train", "eval")
"""What can change a result."""

LEFT_OUT = ("atlas", "report", "film", "playing", "census", "diagnosis", "__pycache__")
"""Rooms that read results and make none."""


@cache
def code_version() -> str:
    """SHA-256 over the code that decides results, 16 hexadecimal digits; docstrings left out."""
    digest = hashlib.sha256()
    for room in ROOMS:
        folder = Path(import_module(f"integ_gym.{room}").__path__[0])
        files = {path.relative_to(folder): path for path in folder.rglob("*.py")}
        sources = {f"{room}/{name.as_posix()}": path for name, path in files.items()
                   if not set(name.parent.parts) & set(LEFT_OUT)}  # fmt: skip
        for name, path in sorted(sources.items()):
            digest.update(name.encode())
            digest.update(_bare(path.read_text(encoding="utf-8")).encode())
    return digest.hexdigest()[:16]


def _bare(source: str) -> str:
    """A module's syntax tree without its docstrings and other idle texts."""
    tree = ast.parse(source)
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if isinstance(body, list):
            body[:] = [one for one in body if not _is_text(one)] or [ast.Pass()]
    return ast.dump(tree)


def _is_text(node: ast.AST) -> bool:
    constant = isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
    return constant and isinstance(node.value.value, str)  # type: ignore[attr-defined]


Rates = npt.NDArray[np.float64]

KEY = b"integ-gym atlas"
"""Of the description in the file's metadata."""

LARGEST = 8 << 20
"""Bytes of a summary, at most."""

PACKAGES = ("integ-gym", "numpy", "jax", "jaxlib")
"""Packages whose versions are recorded."""

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

    origin = msgspec.json.encode(summary.origin)
    sink = pa.BufferOutputStream()
    table = summary.rows.replace_schema_metadata({KEY: origin})
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
        raise InputError(f"{path} is no summary of an atlas's block: {error}") from None
    if origin.specification.get("perturbations") == []:  # as summaries before 1.0.0rc2 have it
        origin.specification["variations"] = origin.specification.pop("perturbations")
    return Summary(origin, table.replace_schema_metadata(None))


FILE = "agreements.json"
"""Beside the summaries."""

MARGIN = 0.05
"""Largest difference of mean success that is let pass as none."""


class Agreement(msgspec.Struct, frozen=True):
    """Two versions of the code, and how a block that both ran came out.

    Attributes:
        codes: both versions.
        block: name of what was run again.
        policies: that were trained again.
        rows: policies times cells that were compared.
        difference: of mean success over all rows, again less before, and its 95 % interval over
            seeds; None: every outcome and every policy was the same.
    """

    codes: tuple[str, str]
    block: str
    policies: int
    rows: int
    difference: tuple[float, float, float] | None = None


def compare(name: str, first: Summary, again: Summary) -> Agreement:
    """Hold what was run again against what there was.

    The same processor gives the same policies to the last bit. Another rounds otherwise, and
    training does not forget it. A whole block then agrees if the 95 % interval of the difference of
    mean success lies within `MARGIN`, and no training ground's differs by more than chance.

    Args:
        name: of the block.
        first: its summary.
        again: of all or some of the same policies.

    Raises:
        ValueError: naming the first outcome that differs, where the processor is known to be the
            same or not the whole block was run again; else what differs by more than chance.
    """
    differing = first_difference(first, again)
    before, after = first.rows.to_pylist(), again.rows.to_pylist()
    codes = (first.origin.code, again.origin.code)
    difference = None
    if differing is not None:
        whole = {_key(row) for row in before} == {_key(row) for row in after}
        if same_processor(first, again) or not whole:
            raise InputError(f"block {name}, {differing} differ between code {' and '.join(codes)}")
        difference = _difference_by_chance(name, _success(before), _success(after))
    policies = len({(row["home"], row["seed"]) for row in after})
    return Agreement(codes, name, policies, len(after), difference)


def same_processor(first: Summary, again: Summary) -> bool:
    """Whether both were run on processors that are known to compute alike."""
    known = first.origin.instruction_sets
    return bool(known) and known == again.origin.instruction_sets


def first_difference(first: Summary, again: Summary) -> str | None:
    """The first outcome that is not what it was, in words; None: all that was run again is."""
    known = {_key(row): row for row in first.rows.to_pylist()}
    for row in again.rows.to_pylist():
        old = known.get(_key(row))
        different = [name for name in row if old is None or row[name] != old[name]]
        if different:
            return f"seed {row['seed']} of {row['home']} in {row['cell']}: {', '.join(different)}"
    return None


def _success(rows: Sequence[Mapping[str, Any]]) -> dict[str, Rates]:
    """Mean success over cells, by training ground, shape (seeds,)."""
    found: dict[str, dict[int, list[float]]] = defaultdict(lambda: defaultdict(list))
    for row in rows:
        found[row["home"]][row["seed"]].append(row["successes"] / row["episodes"])
    return {
        home: np.array([fmean(seeds[seed]) for seed in sorted(seeds)])
        for home, seeds in found.items()
    }


def _difference_by_chance(
    name: str, before: Mapping[str, Rates], after: Mapping[str, Rates]
) -> tuple[float, float, float]:
    """Difference of mean success over all, with its 95 % interval over seeds.

    Raises:
        ValueError: where it, or that of one training ground, is more than chance.
    """
    changes = {home: after[home] - before[home] for home in before}
    level = 1.0 - 0.05 / len(changes)
    intervals = {home: mean_interval(values, level) for home, values in changes.items()}
    overall = mean_interval(np.mean(list(changes.values()), axis=0))
    for home, found in intervals.items():
        if found is None or overall is None:
            raise InputError("one seed cannot show what another processor changes")
        low, high = found.ends
        if low > 0.0 or high < 0.0:
            raise InputError(f"block {name}, success of {home} differs by {found}")
    assert overall is not None
    low, high = overall.ends
    if max(-low, high) > MARGIN:
        raise InputError(f"block {name}, success may differ: by {overall}")
    return overall.estimate, low, high


def note(agreement: Agreement, folder: Path) -> None:
    """Add an agreement to those of a folder of summaries."""
    noted = [one for one in read_agreements(folder) if one != agreement]
    content = msgspec.json.format(msgspec.json.encode([*noted, agreement]), indent=1)
    replace_file(folder / FILE, content + b"\n")


def read_agreements(folder: Path) -> list[Agreement]:
    """The agreements of a folder of summaries."""
    file = folder / FILE
    return msgspec.json.decode(file.read_bytes(), type=list[Agreement]) if file.exists() else []


def check_agree(summaries: Sequence[Summary], agreements: Iterable[Agreement]) -> None:
    """Refuse to combine summaries of code that was never held against each other.

    Raises:
        ValueError: naming two such versions.
    """
    codes = list(dict.fromkeys(one.origin.code for one in summaries))
    reached, pairs = set(codes[:1]), [set(one.codes) for one in agreements]
    while grown := {code for pair in pairs if pair & reached for code in pair} - reached:
        reached |= grown
    apart = [code for code in codes if code not in reached]
    if apart:
        raise InputError(
            f"summaries of code {codes[0]} and {apart[0]} were never compared; run a block "
            "again with `integ-gym atlas SPEC --again BLOCK`"
        )


def _key(row: dict[str, object]) -> tuple[object, ...]:
    return row["home"], row["seed"], row["cell"]


@dataclass(frozen=True)
class Point:
    """Policies of one training ground at one limit of the control.

    Attributes:
        ratio: limit of the control over the critical one of the truth.
        home: what they were trained on.
        seeds: training seeds.
        at_home: success rate there, shape (seeds,).
        on_truth: the same on the truth.
        recovered: the same within two horizons.
    """

    ratio: float
    home: Home
    seeds: tuple[int, ...]
    at_home: Rates
    on_truth: Rates
    recovered: Rates

    @property
    def learned(self) -> bool:
        """Whether the task was learned at home."""
        return bool(self.at_home.mean() >= LEARNED)


def points(
    atlas: Atlas, summaries: Sequence[tuple[Block, Summary]], agreements: Iterable[Agreement] = ()
) -> list[Point]:
    """One point for every ratio that was run and everything that was trained on.

    Args:
        atlas: what was run.
        summaries: of finished blocks.
        agreements: between the versions of the code that made them.

    Raises:
        ValueError: if versions of the code were never held against each other.
    """
    check_agree([summary for _, summary in summaries], agreements)
    truth = atlas.panel.reference
    assert truth is not None
    found = []
    for ratio in sorted({block.ratio for block, _ in summaries}):
        own = [(block, summary) for block, summary in summaries if block.ratio == ratio]
        rows = {_key(row): row for _, summary in own for row in summary.rows.to_pylist()}
        seeds = tuple(sorted({row["seed"] for row in rows.values()}))
        exact = {truth.name: 1.0}
        for home in own[0][0].panel.train:
            shares = {member.name: share for member, share in home.shares.items()}
            at_home, on_truth, recovered = (
                _rates(rows, home.name, seeds, cells, count)
                for cells, count in (
                    (shares, "successes"), (exact, "successes"), (exact, "recovered"),
                )
            )  # fmt: skip
            found.append(Point(ratio, home, seeds, at_home, on_truth, recovered))
    return found


def _rates(
    rows: Mapping[Any, Any], home: str, seeds: Sequence[int], cells: Mapping[str, float], count: str
) -> Rates:
    """Success rate by seed, over cells by their shares."""
    by_seed = [[(rows[home, seed, cell], x) for cell, x in cells.items()] for seed in seeds]
    return np.array([sum(x * row[count] / row["episodes"] for row, x in own) for own in by_seed])
