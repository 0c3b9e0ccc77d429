"""Parquet files of records: written, checked, read, and queried in SQL."""

from __future__ import annotations

import random
from collections.abc import Collection, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import contextmanager
from glob import escape
from itertools import chain
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from integ_gym.support.errors import InputError
from integ_gym.support.optional import load
from integ_gym.support.storage import parquet_files
from integ_gym.support.terminal import SHORT_OF_MEMORY, is_short_of_memory

from .fields import SCHEMA_VERSION, SUMMARY_FIELDS
from .schema import VERSION_KEY, EvidenceError, arrow_type, duckdb, is_trace, parquet, pyarrow

_GROUP_BYTES = 12 << 20
"""Memory of the rows of a group, about, where their number allows."""

_FEWEST_ROWS, _MOST_ROWS = 512, 1 << 16
"""Of a group, but for the last: a query reads the header of every group."""

_LEVEL = 1

_BATCH = 1 << 20
"""Numbers that the writer encodes at once: more than a column of a group mostly has."""

_REPEATING = ("time", "sensor_time", "solver_iterations", "solver_status_code")


def write(tables: Iterable[Any], file: Path) -> None:
    """Write tables of records of one schema, as they come; None stands for no records.

    Traces of real numbers are stored by byte stream; what repeats is stored by dictionary.

    Raises:
        ValueError: if there are no records at all.
    """
    groups = _row_groups(tables)
    first = next(groups, None)
    if first is None:
        raise InputError("a batch needs at least one record, got none")
    with _writer(first.schema, file) as writer:
        for table in chain([first], groups):
            writer.write_table(table, _rows_each(table))


def groups(table: Any) -> Iterator[Any]:
    """Slices of a table, each of which makes a row group."""
    rows = _rows_each(table)
    return (table.slice(first, rows) for first in range(0, table.num_rows, rows))


def _row_groups(tables: Iterable[Any]) -> Iterator[Any]:
    """Tables put together until they make a row group."""
    waiting: list[Any] = []
    rows = size = 0
    for table in tables:
        if table is not None:
            waiting.append(table)
            rows, size = rows + table.num_rows, size + table.nbytes
        if rows >= _rows_per_group(rows, size):
            yield _together(waiting)
            waiting, rows, size = [], 0, 0
    if waiting:
        yield _together(waiting)


def _together(tables: list[Any]) -> Any:
    """Tables below each other.

    Raises:
        EvidenceError: if they have not the same columns.
    """
    first = tables[0].schema
    for table in tables:
        if not table.schema.equals(first):
            raise EvidenceError(
                "records of one environment have different columns or types, so one file cannot "
                "hold them; choose those of one run"
            )
    return pyarrow().concat_tables(tables)


def _writer(schema: Any, file: Path) -> Any:
    numbers = [f.name for f in schema if is_trace(f.name) and "float" in str(f.type)]
    streams = [f"{name}.list.element" for name in numbers if name not in _REPEATING]
    dictionaries = [f.name for f in schema if f.name not in numbers]
    return parquet().ParquetWriter(
        file,
        schema,
        compression="zstd",
        compression_level=_LEVEL,
        write_batch_size=_BATCH,
        use_dictionary=dictionaries + [f"{name}.list.element" for name in _REPEATING],
        use_byte_stream_split=streams,
        write_statistics=[f.name for f in schema if not is_trace(f.name)],
    )


def _rows_each(table: Any) -> int:
    """Rows of the groups, of about equal size, that a table makes."""
    rows: int = table.num_rows
    parts = max(1, rows // _rows_per_group(rows, table.nbytes))
    return -(-rows // parts)


def _rows_per_group(rows: int, size: int) -> int:
    """How many of ``rows``, of ``size`` bytes in all, make a group."""
    wanted = _GROUP_BYTES * rows // size if size else 0
    return min(_MOST_ROWS, max(_FEWEST_ROWS, wanted))


def read(file: Path, *, trace: bool = True, **selection: Any) -> Any:
    """Columns or rows of one file as an Arrow table.

    Args:
        file: a committed file.
        trace: whether to read the traces.
        selection: ``columns`` and ``filters`` of ``pyarrow.parquet.read_table``.

    Raises:
        EvidenceError: for a file that cannot be read or has another schema version.
    """
    with _open(file) as opened:
        if not trace:
            names = opened.schema_arrow.names
            selection["columns"] = [name for name in names if not is_trace(name)]
        return parquet().read_table(file, partitioning=None, **selection)


def parts(file: Path, ids: Collection[str] = ()) -> Iterator[Any]:
    """The row groups of one file as Arrow tables, so that no more than one is in memory.

    Args:
        file: a committed file.
        ids: of the rows that are wanted; by default all.

    Raises:
        EvidenceError: for a file that cannot be read or has another schema version.
    """
    with _open(file) as opened:
        for group in range(opened.num_row_groups):
            if not ids:
                yield opened.read_row_group(group)
                continue
            held = opened.read_row_group(group, columns=["record_id"]).column(0).to_pylist()
            if places := [place for place, name in enumerate(held) if name in ids]:
                yield opened.read_row_group(group).take(places)


def sample(file: Path, count: int) -> Any:
    """At most so many rows of one row group, drawn at random, as an Arrow table.

    Raises:
        EvidenceError: for a file that cannot be read or has another schema version.
    """
    with _open(file) as opened:
        group = opened.read_row_group(random.randrange(opened.num_row_groups))
        return group.take(random.sample(range(group.num_rows), min(count, group.num_rows)))


@contextmanager
def _open(file: Path) -> Iterator[Any]:
    """A file that has all fields of its schema version; see :func:`check_schema`."""
    check_schema(file)
    try:
        with parquet().ParquetFile(file) as opened:
            yield opened
    except _errors() as error:
        raise _unreadable(file, error) from None


def check_schema(file: Path | str, on: Any = None) -> Any:
    """The Arrow schema of a file that has all fields of its schema version.

    Args:
        file: the file.
        on: the Arrow file system that it is on; by default this machine's.

    Raises:
        EvidenceError: for another file, with the remedy.
    """
    schema = _metadata(file, on).schema.to_arrow_schema()
    version = (schema.metadata or {}).get(VERSION_KEY, b"none").decode()
    if version not in map(str, range(1, SCHEMA_VERSION + 1)):
        raise EvidenceError(
            f"{file} has schema version {version}, and this integ-gym reads 1 to {SCHEMA_VERSION}; "
            "read it with the version that wrote it, or move it away"
        )
    remedy = "restore it from a copy or move it away"
    present = set(schema.names)
    lacking = [f.name for f in SUMMARY_FIELDS if f.since <= int(version) and f.name not in present]
    if lacking:
        raise EvidenceError(f"{file} lacks the columns {', '.join(lacking)}; {remedy}")
    kinds = {field.name: arrow_type(field.kind) for field in SUMMARY_FIELDS}
    types = pyarrow().types
    for column in schema:
        if column.name in kinds:
            wanted, fits = kinds[column.name], column.type == kinds[column.name]
        else:
            inner = column.type.value_type if types.is_list(column.type) else pyarrow().null()
            wanted, fits = "a list of numbers", types.is_floating(inner) or types.is_integer(inner)
        if not fits:
            raise EvidenceError(
                f"{file}: column {column.name} is {column.type} where {wanted} was expected; "
                f"{remedy}"
            )
    return schema


def row_count(file: Path) -> int:
    """Number of records in a file.

    Raises:
        EvidenceError: for a file that cannot be read.
    """
    return int(_metadata(file).num_rows)


def _metadata(file: Path | str, on: Any = None) -> Any:
    try:
        return parquet().read_metadata(file, filesystem=on)
    except _errors() as error:
        raise _unreadable(file, error) from None


def _errors() -> tuple[type[Exception], ...]:
    """What reading a file ends in; Arrow's kinds are not all Python's too."""
    return (OSError, ValueError, MemoryError, pyarrow().lib.ArrowException)


def _unreadable(file: Path | str, error: Exception) -> EvidenceError:
    reason, remedy = " ".join(str(error).split()), "restore it from a copy or move it away"
    if is_short_of_memory(error):
        reason = f"{SHORT_OF_MEMORY} ({reason})"
        remedy = "close other programs, or raise the limit that this one runs under"
    return EvidenceError(f"cannot read {file}: {reason}; {remedy}")


_ONE_STATEMENT = (
    "a query is one statement that reads, such as SELECT; to write a file, use "
    "`integ-gym evidence export`, or --format csv and the shell's >"
)


def query(files: Sequence[Path] | Any, sql: str) -> Any:
    """Run SQL over the view ``records``, which holds all files with their columns united.

    Nothing but these files can be read, nothing written, and no extension loaded; what does not fit
    into memory goes to the system's folder for temporary files.

    Args:
        files: committed files, or the data set of Arrow that they make, which DuckDB asks for the
            columns and rows that it needs.
        sql: one statement in DuckDB's dialect that reads: `SELECT`, `DESCRIBE`, `PIVOT`, ….

    Returns:
        An Arrow table.

    Raises:
        EvidenceError: if the statement does more than read, or DuckDB refuses it.
        KeyboardInterrupt: if it is interrupted.
    """
    engine = duckdb()
    extensions = ("autoinstall_known_extensions", "autoload_known_extensions")
    with (
        TemporaryDirectory(prefix="integ-gym-", ignore_cleanup_errors=True) as spill,
        engine.connect(
            config={**dict.fromkeys(extensions, False), "temp_directory": spill}
        ) as connection,
    ):
        try:
            _offer(connection, files)
            _check_reads(engine, connection, sql)
            return _interruptible(connection, sql)
        except engine.Error as error:
            reason = str(error).split("\n\nLINE")[0]
            raise EvidenceError(
                f"DuckDB refuses the query: {reason}; `DESCRIBE records` lists the columns"
            ) from None


def _interruptible(connection: Any, sql: str) -> Any:
    """The statement's result, as an Arrow table.

    DuckDB works beside the caller's thread, for where all work is done by threads of its own it
    heeds no signal.
    """
    with ThreadPoolExecutor(1) as pool:
        working = pool.submit(lambda: connection.sql(sql).to_arrow_table())
        try:
            return working.result()
        except KeyboardInterrupt:
            while not working.done():
                connection.interrupt()
                wait([working], timeout=0.1)
            raise


def _offer(connection: Any, files: Sequence[Path] | Any) -> None:
    """Make the view, and forbid everything else for good."""
    paths = [str(file.resolve()) for file in files] if isinstance(files, Sequence) else []
    patterns = [escape(path) for path in paths]
    if paths:
        relation = connection.read_parquet(patterns, union_by_name=True)
    else:
        relation = connection.register("_files", files).table("_files")
    absent = [field.name for field in SUMMARY_FIELDS if field.name not in relation.columns]
    later = "".join(f", NULL AS {name}" for name in absent)
    relation.project(f"*{later}").create_view("records")
    connection.execute("SET allowed_paths = ?", [[*paths, *patterns]])
    connection.execute("SET enable_external_access = false")
    connection.execute("SET lock_configuration = true")


def _check_reads(engine: Any, connection: Any, sql: str) -> None:
    """Refuse what is not one statement whose result could stand in a `FROM`.

    A `PIVOT` is several statements to DuckDB, and so is what writes its result somewhere.
    """
    reading = (engine.StatementType.SELECT, engine.StatementType.MULTI)
    try:
        sql.encode()
    except UnicodeEncodeError:
        raise EvidenceError("the query is no text in UTF-8; write it anew") from None
    statements = connection.extract_statements(sql)
    if len(statements) != 1 or statements[0].type not in reading:
        raise EvidenceError(_ONE_STATEMENT)
    bare = sql.rstrip().rstrip(";")
    try:
        within = connection.extract_statements(f"SELECT * FROM (\n{bare}\n)")
    except engine.ParserException:
        raise EvidenceError(_ONE_STATEMENT) from None
    if len(within) != 1:
        raise EvidenceError(_ONE_STATEMENT)


def query_in_place(url: str, sql: str) -> Any:
    """Run SQL over the view ``records`` of a run in an object store; see `EvidenceStore.query`.

    Of the files no more is read than the statement needs: footers, columns, row groups. DuckDB asks
    Arrow for them; it itself can read nothing, there or here.

    Args:
        url: of the run: ``s3://…``, ``gs://…`` or ``az://…``.
        sql: one statement in DuckDB's dialect that reads.

    Returns:
        An Arrow table.

    Raises:
        EvidenceError: if there are no records, a file is not readable, the statement does more
            than read, or DuckDB refuses it.
        StorageError: if the store does not answer.
        ModuleNotFoundError: without the extra ``storage``, with the command that installs it.
    """
    files, names = parquet_files(url, "evidence")
    if not names:
        raise EvidenceError(
            f"{url} holds no evidence (evidence/*.parquet); give the place that a run was written "
            "to"
        )
    systems, datasets = (load(f"pyarrow.{name}", "evidence") for name in ("fs", "dataset"))
    on = systems.PyFileSystem(systems.FSSpecHandler(files))
    schemas = [check_schema(name, on) for name in names]
    schema = pyarrow().unify_schemas(schemas, promote_options="permissive")
    parts = [datasets.dataset(n, schema=schema, filesystem=on, format="parquet") for n in names]
    return query(datasets.dataset(parts), sql)
