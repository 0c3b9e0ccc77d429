"""Packages of the extra ``evidence``, imported where they are used."""

from __future__ import annotations

import importlib
from typing import Any

INSTALL = 'pip install "integ-gym[evidence]"'


def load(module: str) -> Any:
    """Import ``module``.

    Raises:
        ModuleNotFoundError: if its package is not installed, with the command that installs it.
    """
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        package = module.partition(".")[0]
        if error.name is None or error.name.partition(".")[0] != package:
            raise
        raise ModuleNotFoundError(
            f"evidence needs {package}, which is not installed: {INSTALL}", name=package
        ) from None


def pyarrow() -> Any:
    """``pyarrow``; see :func:`load`."""
    return load("pyarrow")


def parquet() -> Any:
    """``pyarrow.parquet``; see :func:`load`."""
    return load("pyarrow.parquet")


def duckdb() -> Any:
    """``duckdb``; see :func:`load`."""
    return load("duckdb")
