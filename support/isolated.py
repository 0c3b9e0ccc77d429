"""Packages whose pins fit no others': a Python environment of their own, and a process in it."""

from __future__ import annotations

import contextlib
import json
import os
import queue
import subprocess
import tempfile
import threading
import weakref
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import IO, Any

from .errors import InputError, IntegGymError, MissingPackageError

PATIENCE = 120.0
"""Time in which a call is answered, s, where nothing else is said."""

SETTINGS = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "CUDA_VISIBLE_DEVICES": ""}
"""Environment variables of the process: one thread, on the processor."""

_MOST = 200
"""Characters of a process's last words, or of what is no answer, that a message quotes."""


class WorkerError(IntegGymError, RuntimeError):
    """A process did not answer, or with an error; one sentence says which."""


class Worker:
    """A process that answers calls one after the other, and ends with this object.

    Args:
        name: what messages call it.
        command: that starts it.
    """

    def __init__(self, name: str, command: Sequence[str]) -> None:
        self.name = name
        self._words = tempfile.TemporaryFile()  # noqa: SIM115
        self._process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self._words,
            text=True, encoding="utf-8", env={**os.environ, **SETTINGS}, start_new_session=True,
        )  # fmt: skip
        assert self._process.stdin is not None
        self._calls = self._process.stdin
        self._answers: queue.SimpleQueue[str] = queue.SimpleQueue()
        self._over = f"{name} was closed"
        reading = (self._process.stdout, self._answers)
        threading.Thread(target=_read, args=reading, daemon=True).start()
        self.close = weakref.finalize(self, _end, self._process, self._words)

    def call(self, method: str, patience: float = PATIENCE, **given: Any) -> Any:
        """What a method of the served class gives.

        Args:
            method: its name.
            patience: time in which it is answered, s.
            given: its arguments, as JSON has them.

        Raises:
            ValueError: what the method raised as such.
            WorkerError: for any other error, for a process that has ended, for one that does not
                answer in time, which is ended, and for an answer that is none.
        """
        if not self.close.alive:
            raise WorkerError(self._over)
        line = self._answer(method, json.dumps({"call": method, "given": given}), patience)
        try:
            ((kind, value),) = json.loads(line).items()
        except (ValueError, AttributeError):
            kind, value = "", None
        if kind == "value":
            return value
        if kind == "refused":
            raise InputError(value)
        if kind == "error":
            raise WorkerError(f"{self.name} failed in `{method}`: {value}")
        quoted = repr(line.strip()[:_MOST])
        raise self._end_error(f"gave no readable answer to `{method}`, and was ended: {quoted}")

    def _answer(self, method: str, text: str, patience: float) -> str:
        """The line that comes back."""
        try:
            self._calls.write(text + "\n")
            self._calls.flush()
            line = self._answers.get(timeout=patience)
        except BrokenPipeError:
            line = ""
        except queue.Empty:
            why = f"did not answer `{method}` within {patience:g} s, and was ended"
            raise self._end_error(why) from None
        if not line:
            code, last = self._process.wait(), last_words(self._words)
            raise self._end_error(f"ended with exit code {code} when asked for `{method}`{last}")
        return line

    def _end_error(self, why: str) -> WorkerError:
        self._over = f"{self.name} {why}"
        self.close()
        return WorkerError(self._over)


def last_words(output: IO[bytes]) -> str:
    """What a process wrote last, as the end of a sentence; empty for nothing."""
    output.seek(0)
    lines = output.read().decode(errors="replace").strip().splitlines()
    return f"; its last words: {lines[-1].strip()[:_MOST]}" if lines else ""


def _read(answers: IO[str], into: queue.SimpleQueue[str]) -> None:
    """Pass on every line; the empty text when there are no more."""
    with answers:
        for line in answers:
            into.put(line)
    into.put("")


def _end(process: subprocess.Popen[str], words: IO[bytes]) -> None:
    process.kill()
    process.wait()
    words.close()
    assert process.stdin is not None
    with contextlib.suppress(BrokenPipeError):
        process.stdin.close()


CLONE = Path(__file__).resolve().parents[1]
"""Folder that the environments are set up in: the repository's, in a clone of it."""

SERVING = Path(__file__).with_name("isolated_serving.py")


@dataclass(frozen=True)
class IsolatedEnvironment:
    """A Python environment of its own, that ``make NAME`` sets up in the folder ``.NAME``.

    Attributes:
        name: its name, and that of the distribution that it is for.
    """

    name: str

    @property
    def variable(self) -> str:
        """Environment variable that names another interpreter."""
        return f"INTEG_GYM_{self.name.upper()}_PYTHON"

    @property
    def command(self) -> str:
        """What sets it up."""
        return f"make {self.name}"

    @property
    def python(self) -> Path:
        """Its interpreter, whether it is there or not."""
        return Path(os.environ.get(self.variable) or CLONE / f".{self.name}" / "bin" / "python")

    @property
    def installed(self) -> bool:
        """Whether it is there."""
        return self.python.is_file()

    def version(self) -> str | None:
        """Version of the distribution that it is for; None where it is not set up."""
        return _version(self.python, self.name) if self.installed else None

    def start(self, served: Path) -> Worker:
        """A process that serves a file of ours with its interpreter.

        Args:
            served: file that defines a class ``Served``, whose methods can be called.

        Raises:
            ModuleNotFoundError: where the environment is not set up, with what does it.
        """
        if not self.installed:
            raise MissingPackageError(
                f"{self.name} has an environment of its own, and {self.python} is not there; run: "
                f"{self.command} (in a clone of integ-gym), or name its interpreter in the "
                f"environment variable {self.variable}",
                name=self.name,
            )
        return Worker(self.name, [str(self.python), "-I", str(SERVING), str(served)])


ISOLATED: Mapping[str, IsolatedEnvironment] = MappingProxyType(
    {name: IsolatedEnvironment(name) for name in ("isaaclab", "dm_control")}
)
"""Distribution to the environment of its own."""


@cache
def _version(python: Path, package: str) -> str | None:
    ask = f"from importlib.metadata import version; print(version({package!r}))"
    done = subprocess.run(
        [str(python), "-I", "-c", ask], capture_output=True, text=True, check=False
    )
    return done.stdout.strip() or None
