"""Packages of the extra ``evidence``, imported where they are used."""

from __future__ import annotations

from functools import partial

from integ_gym.support.optional import load

pyarrow = partial(load, "pyarrow", "evidence")
"""``pyarrow``; see :func:`integ_gym.support.optional.load`."""

compute = partial(load, "pyarrow.compute", "evidence")
"""``pyarrow.compute``."""

parquet = partial(load, "pyarrow.parquet", "evidence")
"""``pyarrow.parquet``."""

duckdb = partial(load, "duckdb", "evidence")
"""``duckdb``."""
