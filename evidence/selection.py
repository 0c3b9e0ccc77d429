"""Which records are exported, and their steps."""

from __future__ import annotations

import csv
import json
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, TextIO

import numpy as np

from integ_gym.envs.ops.ops import Array
from integ_gym.envs.registries import ENVIRONMENTS
from integ_gym.support.terminal import plural

from .episodes import choices, native_setup
from .fields import SUMMARY_FIELDS
from .parquet_file import check_schema, parts, read
from .record import EvidenceRecord, records_of
from .schema import EvidenceError, compute, described, is_trace
from .store import EvidenceStore


def write_csv(records: Iterable[EvidenceRecord], file: TextIO) -> int:
    """Write records as CSV with a header, lists as JSON; how many.

    Args:
        records: their traces are not needed.
        file: where to, opened with ``newline=""``.
    """
    writer = csv.DictWriter(file, [field.name for field in SUMMARY_FIELDS], lineterminator="\n")
    writer.writeheader()
    count = 0
    for record in records:
        summary = record.summary()
        writer.writerow(summary | {"initial_state": json.dumps(summary["initial_state"])})
        count += 1
    return count


def write_jsonl(records: Iterable[EvidenceRecord], file: TextIO) -> int:
    """Write records as lines of JSON, after the published JSON Schema; how many."""
    count = 0
    for record in records:
        file.write(json.dumps(record.summary(), ensure_ascii=False, allow_nan=False) + "\n")
        count += 1
    return count


_CHOSEN = "SELECT record_id, env_id, reward IS NOT NULL AS traced FROM records WHERE"


@dataclass
class Selection:
    """Some records of a store.

    Attributes:
        store: that holds them.
        where: condition that they meet, in SQL.
        ids: of the records.
        env_ids: of their environments, sorted.
        left_out: why records that were asked for are not among them, in words, to how many.
        report: called with the number of records read since its last call.
    """

    store: EvidenceStore
    where: str
    ids: frozenset[str]
    env_ids: tuple[str, ...]
    left_out: Counter[str] = field(default_factory=Counter)
    report: Callable[[int], Any] = lambda count: None

    @property
    def env_id(self) -> str:
        """The one environment.

        Raises:
            EvidenceError: if there are several.
        """
        if len(self.env_ids) > 1:
            raise EvidenceError(
                f"the records are of {' and '.join(self.env_ids)}, and a data set of episodes is "
                f"of one environment; choose it: --where \"env_id = '{self.env_ids[0]}'\""
            )
        return self.env_ids[0]

    def episodes(self, *, trace: bool = True) -> Iterator[EvidenceRecord]:
        """The records, file by file; with traces no more than a row group is in memory."""
        for file in self.store.files():
            for table in parts(file, self.ids) if trace else (read(file, trace=False),):
                for record in records_of(table):
                    if record["record_id"] in self.ids:
                        yield record
                        self.report(1)

    def tables(self, env_id: str) -> Iterator[Any]:
        """The rows of one environment as Arrow tables, as they are stored."""
        for file in self.store.files():
            for table in parts(file, self.ids):
                own = table.filter(compute().equal(table.column("env_id"), env_id))
                if own.num_rows:
                    yield own
                    self.report(own.num_rows)

    def distinct(self, column: str) -> list[Any]:
        """Values of a column, each once, in order."""
        return sorted(set(self._values(column)), key=lambda x: (x is None, str(x)))

    def _values(self, columns: str) -> list[Any]:
        """Values of columns, record by record."""
        rows = self.store.query(f"SELECT record_id, ({columns}) AS it FROM records").to_pylist()
        return [row["it"] for row in rows if row["record_id"] in self.ids]

    @cached_property
    def columns(self) -> dict[str, dict[str, str]]:
        """What is said of each trace column that some record has, by name in their order."""
        facts: dict[str, dict[str, str]] = {}
        for file in self.store.files():
            env_ids = read(file, columns=["env_id"]).column(0).unique().to_pylist()
            if set(self.env_ids) & set(env_ids):
                facts |= {x.name: described(x) for x in check_schema(file) if is_trace(x.name)}
        counted = ", ".join(f'count("{name}") AS "{name}"' for name in facts)
        known = self.store.query(f"SELECT {counted} FROM records").to_pylist()[0] if facts else {}
        return {name: about for name, about in facts.items() if known[name]}

    def discretizations(self) -> list[dict[str, Any]]:
        """Engine, integrator, steps in s, and how many records have them."""
        names = ("engine", "integrator", "dt", "control_period")
        packed = "{" + ", ".join(f"'{name}': {name}" for name in names) + "}"
        counts = Counter(map(json.dumps, self._values(packed)))
        return [{**json.loads(key), "records": counts[key]} for key in sorted(counts)]


def select(store: EvidenceStore, where: str, *, traced: bool) -> Selection:
    """Records that meet a condition.

    Args:
        store: that holds them.
        where: in SQL.
        traced: whether only those with a trace are of use.

    Raises:
        EvidenceError: if DuckDB refuses the condition, or nothing is left.
    """
    rows = store.query(f"{_CHOSEN} ({where})").to_pylist()
    if not rows:
        raise EvidenceError(
            f"no record of {store.directory} fulfils {where!r}; give another condition"
        )
    chosen = [row for row in rows if row["traced"] or not traced]
    without = len(rows) - len(chosen)
    if not chosen:
        raise EvidenceError(
            f"none of {plural(without, 'record')} has a trace, and this format is of what happened "
            "step by step; record with traces, or export to csv, jsonl or parquet"
        )
    left_out = Counter({"without a trace": without} if without else {})
    ids = frozenset(row["record_id"] for row in chosen)
    return Selection(store, where, ids, tuple(sorted({row["env_id"] for row in chosen})), left_out)


NO_CHOICE = "in which the fallback acted, which is no action of the discrete set"


@dataclass(frozen=True)
class Columns:
    """Trace columns by what they are.

    Attributes:
        sensed: observations.
        states: true state.
        controls: commanded.
        instants: further values at control instants.
        steps: further values of control steps.
    """

    sensed: tuple[str, ...]
    states: tuple[str, ...]
    controls: tuple[str, ...]
    instants: tuple[str, ...]
    steps: tuple[str, ...]


def columns_of(facts: Mapping[str, Mapping[str, str]]) -> Columns:
    """Trace columns by what they are, from what is said of each."""
    at = {name: about["at"] for name, about in facts.items()}
    sensed = tuple(name for name in at if name.startswith("sensed_"))
    controls = tuple(name for name in at if name.endswith("_commanded"))
    instants = [n for n in at if at[n] == "instant" and n not in sensed]
    known = ("time", "sensor_time", "energy")
    return Columns(
        sensed,
        tuple(name for name in instants if name not in known),
        controls,
        tuple(name for name in instants if name in known),
        tuple(n for n in at if at[n] == "step" and n not in controls),
    )


def column(record: EvidenceRecord, name: str, rows: int) -> Array:
    """A column as numbers of 64 bits; NaN where the record has none."""
    found = record.trace.get(name)
    return np.full(rows, np.nan) if found is None else found.astype(np.float64)


def actions_of(record: EvidenceRecord, controls: tuple[str, ...]) -> Array | None:
    """What was decided: float64 of shape (length, controls), or int64 of shape (length,).

    None where the fallback acted in place of a choice of one of our environments.
    """
    asked = stack(record, controls, len(record.trace["reward"]))
    fields = record.fields
    if fields["env_id"] not in ENVIRONMENTS:
        return asked
    task = native_setup(fields["env_id"], fields["arguments"]).task
    if task.discrete is None:
        return asked
    chosen = choices(task, asked[:, 0])
    return None if np.isnan(chosen).any() else chosen.astype(np.int64)


def stack(record: EvidenceRecord, names: tuple[str, ...], rows: int) -> Array:
    """Columns side by side, float64 of shape (rows, names)."""
    own = [column(record, name, rows) for name in names]
    return np.stack(own, axis=1) if own else np.empty((rows, 0))
