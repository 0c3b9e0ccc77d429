"""The records that are exported, and what they have in common."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

from integ_gym.support.terminal import plural

from ..episodes.record import EvidenceRecord, records_of
from ..schema.arrow import described, is_trace
from ..schema.errors import EvidenceError
from ..schema.extra import pyarrow
from ..store.parquet_file import check_schema, parts, read
from ..store.store import EvidenceStore

_CHOSEN = "SELECT record_id, env_id, {traced} AS traced FROM records WHERE ({where})"


@dataclass
class Selection:
    """Some records of a store.

    Attributes:
        store: that holds them.
        where: condition that they meet, in SQL.
        ids: of the records.
        env_ids: of their environments, sorted.
        left_out: why records that were asked for are not among them, in words, to how many.
        report: told how many records have been read since it was told last.
    """

    store: EvidenceStore
    where: str
    ids: frozenset[str]
    env_ids: tuple[str, ...]
    left_out: dict[str, int] = field(default_factory=dict)
    report: Callable[[int], Any] = lambda count: None

    def leave_out(self, reason: str) -> None:
        """Count a record that the format cannot hold."""
        self.left_out[reason] = self.left_out.get(reason, 0) + 1

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
                kept = [env == env_id for env in table.column("env_id").to_pylist()]
                if any(kept):
                    yield table.filter(pyarrow().array(kept))
                    self.report(sum(kept))

    def distinct(self, column: str) -> list[Any]:
        """Values of a column, each once, in order."""
        return sorted(set(self.values(column)), key=lambda x: (x is None, str(x)))

    def values(self, *columns: str) -> list[Any]:
        """Values of a column, or tuples of some, record by record."""
        rows = self.store.query(f"SELECT record_id, {', '.join(columns)} FROM records").to_pylist()
        told = [tuple(row.values())[1:] for row in rows if row["record_id"] in self.ids]
        return [row[0] for row in told] if len(columns) == 1 else told

    @cached_property
    def columns(self) -> dict[str, dict[str, str]]:
        """What is said of each trace column that some record has, by name in their order."""
        told = {
            one.name: described(one)
            for file in self._files()
            for one in check_schema(file)
            if is_trace(one.name)
        }
        counted = ", ".join(f'count("{name}") AS "{name}"' for name in told)
        known = self.store.query(f"SELECT {counted} FROM records").to_pylist()[0] if told else {}
        return {name: about for name, about in told.items() if known[name]}

    def _files(self) -> list[Path]:
        """The files that hold some of the records."""
        wanted = set(self.env_ids)
        return [f for f in self.store.files() if wanted & set(_env_ids(f))]

    def discretizations(self) -> list[dict[str, Any]]:
        """Engine, integrator, steps in s, and how many records have them."""
        names = ("engine", "integrator", "dt", "control_period")
        counts: dict[str, int] = {}
        for row in self.values(*names):
            key = json.dumps(dict(zip(names, row, strict=True)))
            counts[key] = counts.get(key, 0) + 1
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
    is_traced = "reward IS NOT NULL"
    rows = store.query(_CHOSEN.format(traced=is_traced, where=where)).to_pylist()
    if not rows:
        raise EvidenceError(f"no record of {store.directory} is {where!r}; ask for others")
    chosen = [row for row in rows if row["traced"] or not traced]
    without = len(rows) - len(chosen)
    if not chosen:
        raise EvidenceError(
            f"none of {plural(without, 'record')} has a trace, and this format is of what happened "
            "step by step; record with traces, or export to csv, jsonl or parquet"
        )
    left_out = {"without a trace": without} if without else {}
    ids = frozenset(row["record_id"] for row in chosen)
    return Selection(store, where, ids, tuple(sorted({row["env_id"] for row in chosen})), left_out)


def _env_ids(file: Path) -> list[str]:
    found: list[str] = read(file, columns=["env_id"]).column(0).unique().to_pylist()
    return found
