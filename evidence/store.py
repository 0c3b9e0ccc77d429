"""Evidence stores: directories of Parquet files of records."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from glob import escape
from pathlib import Path
from typing import Any, NamedTuple

from integ_gym.support.errors import InputError
from integ_gym.support.files import remove_leftovers, write_once
from integ_gym.support.processes import prefetch

from .hashing import content_hashes, with_hashes
from .parquet_file import check_schema, groups, parts, query, read, row_count, sample, write
from .record import EvidenceRecord, records_of
from .schema import BatchExistsError, EvidenceError, Finding, pyarrow

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,180}")


class EvidenceStore:
    """Evidence records in a directory.

    Args:
        directory: made by the first commit.
        pattern: of the names of the files that are looked at.
    """

    def __init__(self, directory: str | Path, pattern: str = "*.parquet") -> None:
        self.directory = Path(directory)
        self._pattern = pattern

    @property
    def run(self) -> Path:
        """The directory of the run that the records are of."""
        return self.directory.parent if self.directory.name == "evidence" else self.directory

    def files(self) -> list[Path]:
        """The committed files, sorted."""
        return sorted(file for file in self.directory.glob(self._pattern) if file.is_file())

    def only(self, name: str) -> EvidenceStore:
        """The same with the file of that name alone."""
        return EvidenceStore(self.directory, escape(name))

    def batches(self) -> tuple[str, ...]:
        """Names of the committed batches, sorted."""
        return tuple(file.stem for file in self.files())

    def commit(self, name: str, table: Any) -> Path:
        """Make a batch of records visible by one atomic step.

        Args:
            name: name of the batch: letters, digits, ``.``, ``_`` and ``-``.
            table: Arrow table of records of one environment.

        Raises:
            BatchExistsError: if a batch of that name has been committed.
            ValueError: for a name that cannot be a file's.
        """
        return self.commit_all(name, [table])

    def commit_unhashed(self, name: str, table: Any) -> Path:
        """The same for records whose content hashes are filled in on the way.

        Some rows are hashed while those before are written.

        Args:
            name: name of the batch.
            table: Arrow table of records of one environment; its `content_hash` is not looked at.

        Raises:
            BatchExistsError: if a batch of that name has been committed.
            ValueError: for a name that cannot be a file's.
        """
        return self.commit_all(name, prefetch(map(with_hashes, groups(table))))

    def commit_all(self, name: str, tables: Iterable[Any]) -> Path:
        """Make several tables of records of one environment visible as one batch.

        Args:
            name: name of the batch.
            tables: Arrow tables of records, written as they come; None stands for no records.

        Raises:
            BatchExistsError: if a batch of that name has been committed.
            ValueError: for a name that cannot be a file's, or if there are no records.
        """
        if not _NAME.fullmatch(name):
            raise InputError(
                f"a batch name has up to 181 letters, digits, '.', '_' or '-' and begins with a "
                f"letter or digit, got {name!r}"
            )
        self.directory.mkdir(parents=True, exist_ok=True)
        remove_leftovers(self.directory)
        path = self.directory / f"{name}.parquet"
        try:
            write_once(path, lambda file: write(tables, file))
        except FileExistsError:
            raise BatchExistsError(
                f"batch {name!r} has already been committed to {self.directory}; remove its file "
                "to record it anew, or give another name"
            ) from None
        return path

    def count(self) -> int:
        """Number of records.

        Raises:
            EvidenceError: for a file that cannot be read.
        """
        return sum(row_count(file) for file in self.files())

    def records(self, *, trace: bool = True) -> Iterator[EvidenceRecord]:
        """All records, file by file.

        Args:
            trace: whether to read the traces.

        Raises:
            EvidenceError: for a file that cannot be read or has another schema version.
        """
        for file in self.files():
            yield from records_of(read(file, trace=trace))

    def named_records(self, ids: Collection[str] = ()) -> Iterator[tuple[str, EvidenceRecord]]:
        """Name of the file and record, file by file.

        Args:
            ids: of the records that are wanted; by default all.

        Raises:
            EvidenceError: for a file that cannot be read or has another schema version.
        """
        for file in self.files():
            for part in parts(file, ids):
                yield from ((file.name, record) for record in records_of(part))

    def some_records(self, name: str, count: int) -> list[EvidenceRecord]:
        """Records of the file of that name, at most so many, drawn from one of its row groups.

        Raises:
            EvidenceError: for a file that cannot be read or has another schema version.
        """
        return list(records_of(sample(self.directory / name, count)))

    def episode_indices(self, name: str, **columns: str) -> list[int]:
        """Indices of the episodes in the file of that name whose columns hold these values.

        Raises:
            EvidenceError: for a file that cannot be read or has another schema version.
        """
        wanted = [(column, "=", value) for column, value in columns.items()]
        table = read(self.directory / name, columns=["episode_index"], filters=wanted)
        indices: list[int] = table.column(0).to_pylist()
        return indices

    def find(self, record_id: str) -> EvidenceRecord:
        """The record with that id, or with the one id that begins so.

        Raises:
            EvidenceError: if there is none, or more than one.
        """
        found = [
            (file, full_id)
            for file in self.files()
            for full_id in read(file, columns=["record_id"]).column(0).to_pylist()
            if full_id.startswith(record_id)
        ]
        exact = [match for match in found if match[1] == record_id]
        found = exact or found
        if not found:
            raise EvidenceError(
                f"no record {record_id!r} in {self.directory}; list some with "
                "`integ-gym watch RUN`, or with `integ-gym evidence query RUN "
                '"SELECT record_id, cell, failure_label FROM records LIMIT 20"`'
            )
        if len(found) > 1:
            some = ", ".join(full_id for _, full_id in found[:4])
            raise EvidenceError(
                f"{len(found)} records of {self.directory} begin with {record_id!r}: {some}"
                f"{', ...' if len(found) > 4 else ''}; give more digits"
            )
        file, full_id = found[0]
        return records_of(next(parts(file, [full_id])))[0]

    def query(self, sql: str) -> Any:
        """Run SQL over the view ``records``, which holds all files with their columns united.

        Args:
            sql: one statement in DuckDB's dialect that reads: `SELECT`, `DESCRIBE`, `PIVOT`, ….

        Returns:
            An Arrow table.

        Raises:
            EvidenceError: if there are no records, a file is not readable, the statement does more
                than read, or DuckDB refuses it.
        """
        files = self.files()
        if not files:
            raise EvidenceError(f"{self.directory} holds no evidence")
        for file in files:
            check_schema(file)
        return query(files, sql)

    def verify(self, report: Callable[[int], object] = lambda count: None) -> list[Finding]:
        """Re-compute all content hashes and look for records that are there twice.

        Args:
            report: called now and then with the number of further records checked.
        """
        problems: list[Finding] = []
        seen: dict[str, str] = {}
        for file in self.files():
            try:
                table = read(file)
            except EvidenceError as error:
                problems.append(Finding(file.name, None, str(error)))
                continue
            for part in groups(table):
                problems += _find_alterations(file.name, part)
                report(part.num_rows)
            for record_id in table.column("record_id").to_pylist():
                if record_id in seen:
                    message = f"is also in {seen[record_id]}; remove one of the two files"
                    problems.append(Finding(file.name, record_id, message))
                seen.setdefault(record_id, file.name)
        return problems


def sql_literal(value: object) -> str:
    """A value as a query writes it: a number, or text between quotation marks."""
    if value is None:
        return "NULL"
    return str(value) if isinstance(value, int) else "'" + str(value).replace("'", "''") + "'"


def open_run(run: str | Path) -> EvidenceStore:
    """The store of a run's directory, or of its directory ``evidence``.

    Raises:
        EvidenceError: if there is no such directory, or no evidence in it.
    """
    directory = Path(run)
    if not directory.is_dir():
        raise EvidenceError(f"no directory {directory}; give a run's directory")
    inner = directory / "evidence"
    store = EvidenceStore(inner if inner.is_dir() else directory)
    if not store.files():
        raise EvidenceError(
            f"{store.directory} holds no evidence (*.parquet); give the directory that a run wrote "
            "to, or the one named `evidence` in it"
        )
    return store


def _find_alterations(name: str, table: Any) -> list[Finding]:
    ids = table.column("record_id").to_pylist()
    stored = table.column("content_hash").to_pylist()
    return [
        Finding(name, record_id, f"was altered: content hash {found[:12]}, recorded {own[:12]}")
        for record_id, own, found in zip(ids, stored, content_hashes(table), strict=True)
        if own != found
    ]


class Merged(NamedTuple):
    """What a merge did.

    Attributes:
        records: that were written.
        doubled: that were there already, and left out.
    """

    records: int
    doubled: int


def merge(sources: Sequence[EvidenceStore], target: EvidenceStore) -> Merged:
    """Copy the records of several stores into another, file by file.

    A record that is there already, the same by its content hash, is left out. Nothing is written
    if two records of one id differ.

    Args:
        sources: the stores, in the order in which their records are taken.
        target: where to; what it holds counts as there already.

    Raises:
        EvidenceError: for two records of one id with another content, or a damaged source.
    """
    for store in (*sources, target):
        problems = store.verify()
        if problems:
            raise EvidenceError(
                f"{store.directory} is damaged: {problems[0]}; mend it before it is merged"
            )
    held = _hashes([target])
    taken = set(held)
    added = len(_hashes(sources, held)) - len(taken)
    doubled = sum(store.count() for store in sources) - added
    for store in sources:
        for file in store.files():
            name = _free(file.stem, target)
            fresh = [table for table in _fresh(parts(file), taken) if table.num_rows]
            if fresh:
                target.commit_all(name, fresh)
    return Merged(added, doubled)


def _hashes(
    stores: Sequence[EvidenceStore], held: Mapping[str, str] | None = None
) -> dict[str, str]:
    """Content hash of all records, and of those that are held, by record id.

    Raises:
        EvidenceError: if two records of one id differ.
    """
    known = dict(held or {})
    for store in stores:
        if not store.files():
            continue
        for row in store.query("SELECT record_id, content_hash FROM records").to_pylist():
            name, own = row["record_id"], row["content_hash"]
            if known.setdefault(name, own) != own:
                raise EvidenceError(
                    f"record {name} of {store.directory} differs from the one with that id that "
                    "is there already; merge into a directory without it"
                )
    return known


def _fresh(tables: Iterator[Any], taken: set[str]) -> Iterator[Any]:
    """Rows whose records have not been taken."""
    for table in tables:
        ids = table.column("record_id").to_pylist()
        new = [name not in taken for name in ids]
        taken.update(ids)
        yield table.filter(pyarrow().array(new, pyarrow().bool_()))


def _free(stem: str, target: EvidenceStore) -> str:
    """A batch name that is not taken."""
    names, count, name = set(target.batches()), 2, stem
    while name in names:
        name, count = f"{stem}-{count}", count + 1
    return name
