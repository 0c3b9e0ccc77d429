"""Importing a simulator without what its import does to the rest of the process."""

from __future__ import annotations

import os
import sys
import tempfile
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from typing import Any

from integ_gym.support import load


def load_undisturbed(module: str, extra: str, banner: str | None = None) -> Any:
    """Import a module as :func:`load` does; its first import leaves no trace but the module.

    Environment variables stay as they were, warnings of the import are not shown, and lines of
    standard error that begin with ``banner`` are left out.

    Raises:
        ModuleNotFoundError: if its package is not installed.
    """
    if module in sys.modules:
        return load(module, extra)
    quiet = nullcontext() if banner is None else _standard_error_without(banner.encode())
    with _same_environment(), warnings.catch_warnings(), quiet:
        warnings.simplefilter("ignore")
        return load(module, extra)


@contextmanager
def _same_environment() -> Iterator[None]:
    before = dict(os.environ)
    try:
        yield
    finally:
        for name in os.environ.keys() - before.keys():
            del os.environ[name]
        os.environ.update(before)


@contextmanager
def _standard_error_without(banner: bytes) -> Iterator[None]:
    """Hold back what is written to file descriptor 2; then pass on all lines but the banner."""
    with tempfile.TemporaryFile() as held:
        sys.stderr.flush()
        terminal = os.dup(2)
        os.dup2(held.fileno(), 2)
        try:
            yield
        finally:
            os.dup2(terminal, 2)
            os.close(terminal)
            held.seek(0)
            for line in held:
                if not line.startswith(banner):
                    os.write(2, line)
