"""Simulators kept from what their import and what they say would do to the rest of the process."""

from __future__ import annotations

import os
import sys
import tempfile
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext, redirect_stderr, redirect_stdout
from typing import Any

from integ_gym.support.packages.extras import load


def load_undisturbed(module: str, extra: str, banner: str | None = None) -> Any:
    """Import a module as :func:`load` does; its first import leaves no trace but the module.

    Environment variables stay as they were, warnings of the import are not shown, and lines of
    standard error that begin with ``banner`` are left out.

    Raises:
        ModuleNotFoundError: if its package is not installed.
    """
    if module in sys.modules:
        return load(module, extra)
    heard = nullcontext() if banner is None else _standard_error_without(banner.encode())
    with _same_environment(), warnings.catch_warnings(), heard:
        warnings.simplefilter("ignore")
        return load(module, extra)


@contextmanager
def quiet() -> Iterator[None]:
    """Leave out what is written to stdout and stderr meanwhile, by compiled code too; and warnings.

    Of the whole process: what another thread writes at that time is lost as well.
    """
    with (
        open(os.devnull, "w", encoding="utf-8") as nothing,
        _written_to(nothing.fileno(), 1, 2),
        redirect_stdout(nothing),
        redirect_stderr(nothing),
        warnings.catch_warnings(),
    ):
        warnings.simplefilter("ignore")
        yield


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
        try:
            with _written_to(held.fileno(), 2):
                yield
        finally:
            held.seek(0)
            for line in held:
                if not line.startswith(banner):
                    os.write(2, line)


@contextmanager
def _written_to(target: int, *streams: int) -> Iterator[None]:
    """Let one file descriptor stand for others of the process."""
    sys.stdout.flush()
    sys.stderr.flush()
    kept = [os.dup(stream) for stream in streams]
    try:
        for stream in streams:
            os.dup2(target, stream)
        yield
    finally:
        for stream, copy in zip(streams, kept, strict=True):
            os.dup2(copy, stream)
            os.close(copy)
