"""Packages of the extra ``evidence``, imported where they are used."""

from __future__ import annotations

from typing import Any

from integ_gym.support import load


def pyarrow() -> Any:
    """``pyarrow``; see :func:`integ_gym.support.packages.extras.load`."""
    return load("pyarrow", "evidence")


def parquet() -> Any:
    """``pyarrow.parquet``."""
    return load("pyarrow.parquet", "evidence")


def duckdb() -> Any:
    """``duckdb``."""
    return load("duckdb", "evidence")
