"""Simulators that report what they do on standard output: kept from it while they are made."""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout

_STREAMS = (1, 2)


@contextmanager
def quiet() -> Iterator[None]:
    """Leave out what is written to stdout and stderr meanwhile, by compiled code too; and warnings.

    Of the whole process: what another thread writes at that time is lost as well.
    """
    sys.stdout.flush()
    sys.stderr.flush()
    kept = [os.dup(stream) for stream in _STREAMS]
    try:
        with open(os.devnull, "w", encoding="utf-8") as nothing:
            for stream in _STREAMS:
                os.dup2(nothing.fileno(), stream)
            with redirect_stdout(nothing), redirect_stderr(nothing), warnings.catch_warnings():
                warnings.simplefilter("ignore")
                yield
    finally:
        for stream, copy in zip(_STREAMS, kept, strict=True):
            os.dup2(copy, stream)
            os.close(copy)
