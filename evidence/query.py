"""SQL over records, in which nothing but the records can be read."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from integ_gym.support.optional import load
from integ_gym.support.storage import parquet_files

from .fields import SUMMARY_FIELDS
from .parquet_file import check_schema
from .schema import EvidenceError, duckdb, pyarrow

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
    patterns = [_literal(path) for path in paths]
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


def _literal(path: str) -> str:
    """A path in which no character stands for others."""
    return "".join(f"[{c}]" if c in "*?[" else c for c in path)


def _check_reads(engine: Any, connection: Any, sql: str) -> None:
    """Refuse what is not one statement whose result could stand in a `FROM`.

    A `PIVOT` is several statements to DuckDB, and so is what writes its result somewhere.
    """
    reading = (engine.StatementType.SELECT, engine.StatementType.MULTI)
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
