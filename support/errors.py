"""Errors that a user can mend, and how those of others' code are reported."""

from __future__ import annotations

import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from inspect import isfunction
from pathlib import Path


class IntegGymError(Exception):
    """Something that a user can mend; its message is one sentence with the remedy.

    Commands print it in one line and end with code 2. Any other exception is a defect.
    """


class InputError(IntegGymError, ValueError):
    """A value that cannot be."""


class InputTypeError(IntegGymError, TypeError):
    """A value of a kind that cannot be."""


class MissingPackageError(IntegGymError, ModuleNotFoundError):
    """A package that is not installed; the message has the command that installs it."""


class FileWarning(UserWarning):
    """About a file that each process reads: workers leave it to the process that started them."""


class SetupError(IntegGymError, RuntimeError):
    """Something that a machine or a process cannot do as it is set up."""


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
    """Raise whatever the code of others raises as an `InputError` of one sentence.

    Args:
        what: could not be done, in words, before what the error says.

    Raises:
        InputError: in place of any exception that is no `IntegGymError`.
    """
    try:
        yield
    except IntegGymError:
        raise
    except Exception as error:  # whatever the code of others raises
        raise InputError(f"{what}: {describe_exception(error)}") from error
