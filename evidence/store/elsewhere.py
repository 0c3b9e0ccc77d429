"""Records of a run in an object store, read where they are."""

from __future__ import annotations

from typing import Any

from integ_gym.support.packages.extras import load
from integ_gym.support.storage import parquet_files

from ..schema.errors import EvidenceError
from ..schema.extra import pyarrow
from .parquet_file import check_schema
from .querying import query


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
