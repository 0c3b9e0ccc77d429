"""How a command ends: bad input with one clear line and exit code 2, an absent reader quietly."""

from __future__ import annotations

import errno
import os
import select
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import TextIO

from ..errors import raised_here
from .command_line import sentence
from .text_table import say

INTERRUPTED = 130

SHORT_OF_MEMORY = "there is not enough memory"
_FREE = "close other programs, give it fewer --workers, or raise the limit that it runs under"

_TOLD = (ValueError, TypeError, OSError, ModuleNotFoundError, RuntimeError)
"""Errors that are told in a sentence where this package raised them."""


def end_quietly(run: Callable[[], int]) -> int:
    """Run a command; one whose reader has seen enough, such as `head`, ends without a word.

    Where a standard stream is closed, as under some schedulers, what is written to it goes nowhere.
    """
    nowhere = Path(os.devnull)
    sys.stdout = sys.stdout or nowhere.open("w", encoding="utf-8")
    sys.stderr = sys.stderr or nowhere.open("w", encoding="utf-8")
    try:
        try:
            code = run()
        except SystemExit:
            sys.stdout.flush()
            raise
        sys.stdout.flush()  # what is left would else be written, and refused, at exit
        return code
    except BrokenPipeError:
        unread = [stream for stream in (sys.stdout, sys.stderr) if _has_no_reader(stream)]
        if not unread:
            raise
        for stream in unread:  # what is still to be written goes nowhere
            descriptor = os.open(os.devnull, os.O_WRONLY)
            os.dup2(descriptor, stream.fileno())
            os.close(descriptor)
        return 0


def _has_no_reader(stream: TextIO) -> bool:
    """Whether a stream is a pipe of which the other end is closed."""
    if not hasattr(select, "poll"):
        return True
    poll = select.poll()
    poll.register(stream.fileno(), 0)
    return any(event & (select.POLLERR | select.POLLHUP) for _, event in poll.poll(0))


def report_errors(
    program: str,
    run: Callable[[], int],
    *,
    mark: str = "",
    interrupted: str = "what was finished stays",
) -> int:
    """Run a command; print what the user can mend as one line on standard error.

    Errors that are not about the input are raised with their traceback.

    Args:
        program: the command's name, before every message.
        run: the command.
        mark: before what an error says.
        interrupted: what an interruption leaves.
    """
    try:
        with _interruptions() as noted:
            code = run()
            if noted and code != INTERRUPTED:  # and swallowed by compiled code that called back
                raise KeyboardInterrupt
            return code
    except KeyboardInterrupt:
        say(f"{program}: interrupted; {interrupted}", sys.stderr)
        return INTERRUPTED
    except BrokenPipeError:
        raise
    except Exception as error:
        if is_short_of_memory(error):
            told = sentence(error) or type(error).__name__
            say(f"{program}: {mark}{SHORT_OF_MEMORY} ({told}); {_FREE}", sys.stderr)
            return 2
        if not (isinstance(error, _TOLD) and _is_meant_for_users(error)):
            raise
        say(f"{program}: {mark}{sentence(error)}", sys.stderr)
        return 2


@contextmanager
def _interruptions() -> Iterator[list[int]]:
    """Interruptions so far, each of which is raised as well; none outside the main thread."""
    noted: list[int] = []
    held = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or not callable(held):
        yield noted
        return

    def note(number: int, frame: FrameType | None) -> None:
        noted.append(number)
        held(number, frame)

    signal.signal(signal.SIGINT, note)
    try:
        yield noted
    finally:
        signal.signal(signal.SIGINT, held)


def is_short_of_memory(error: BaseException) -> bool:
    """Whether an error says that memory could not be had: Python's, NumPy's, Arrow's or a system's.

    Arrow tells some as an error of its own kind alone, with what the C++ library said.
    """
    if isinstance(error, MemoryError):
        return True
    if isinstance(error, OSError) and error.errno == errno.ENOMEM:
        return True
    arrow = type(error).__module__.startswith("pyarrow")
    return arrow and any(word in str(error) for word in _ALLOCATING)


_ALLOCATING = ("bad_alloc", "malloc", "realloc", "Cannot allocate memory", "Out of memory")


def _is_meant_for_users(error: Exception) -> bool:
    """Whether the error was raised by this package's own checks."""
    return isinstance(error, OSError) or raised_here(error)
