"""Errors of this package's code told from those of others', and said in one sentence."""

from __future__ import annotations

import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from inspect import isfunction
from pathlib import Path


def raised_here(error: BaseException) -> bool:
    """Whether an error was raised by this package's own code, and not by what it calls."""
    frames = [frame for frame, _ in traceback.walk_tb(error.__traceback__)]
    return bool(frames) and str(frames[-1].f_globals.get("__name__", "")).startswith("integ_gym.")


def is_raised_under(owner: type, error: BaseException) -> bool:
    """Whether an error was raised by a method of a class, or by what that called."""
    methods = (m for base in owner.__mro__ for m in vars(base).values() if isfunction(m))
    codes = {method.__code__ for method in methods}
    return any(frame.f_code in codes for frame, _ in traceback.walk_tb(error.__traceback__))


def describe_exception(error: BaseException) -> str:
    """Kind and message on one line; of an error without a message, the line that raised it."""
    kind, words = type(error).__name__, " ".join(str(error).split()).rstrip(".")
    frames = traceback.extract_tb(error.__traceback__)
    if words or not frames:
        return f"{kind}: {words}" if words else kind
    return f"{kind} in `{frames[-1].line}` ({Path(frames[-1].filename).name})"


@contextmanager
def translate_errors(what: str) -> Iterator[None]:
    """Raise whatever the code of others raises as a `ValueError` of one sentence.

    Args:
        what: could not be done, in words, before what the error says.

    Raises:
        ValueError: in place of an exception that another's code raised.
    """
    try:
        yield
    except Exception as error:  # whatever the code of others raises
        if raised_here(error):
            raise
        raise ValueError(f"{what}: {describe_exception(error)}") from error
