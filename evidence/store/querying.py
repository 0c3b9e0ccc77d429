"""SQL over the records of some files, which reads them and touches nothing else."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from ..schema.errors import EvidenceError
from ..schema.extra import duckdb
from ..schema.fields import SUMMARY_FIELDS

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
