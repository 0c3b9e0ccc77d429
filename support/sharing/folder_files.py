"""Small files in one folder that many processes share, each made by one of them and never changed.

What claims need of a file system, and no more: a file that is there whole or not at all and that
one process alone can make, and the file system's own clock.
"""

from __future__ import annotations

import errno
import os
import time
import uuid
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Protocol

ASKED_EVERY = 300.0
"""Time after which the file system is asked for its time again, s."""


class Gone(Exception):
    """The shared folder is no longer there: the work that it was for is over, or was begun anew."""


class SharedFiles(Protocol):
    """What claims need; names are relative, with at most one folder."""

    def create(self, name: str, text: str) -> bool:
        """Make a file with all its content; False if there is one of that name."""
        ...

    def read(self, name: str) -> str | None:
        """The content of a file, None if there is none."""
        ...

    def exists(self, name: str) -> bool:
        """Whether there is a file."""
        ...

    def touch(self, name: str) -> None:
        """Set a file's time to now, by the file system's clock."""
        ...

    def age(self, name: str) -> float | None:
        """Time since a file was made or touched, both by the file system's clock, s."""
        ...

    def names(self, folder: str) -> list[str]:
        """Names in a folder; none if it is not there."""
        ...

    def close(self) -> None:
        """Remove what this process alone needed."""
        ...


class FolderFiles:
    """Files of a folder on a disk or a file server.

    Args:
        root: the folder, which exists. Where it vanishes, :class:`Gone` is raised from then on.
    """

    def __init__(self, root: Path) -> None:
        self.root = root
        self._clock = root / f".clock-{uuid.uuid4().hex}"
        self._ahead: float | None = None
        self._asked = 0.0

    def create(self, name: str, text: str) -> bool:
        """Make a file with all its content; False if there is one of that name.

        A link gives the file its name: unlike an exclusive creation it is never seen half-written.
        """
        path = self.root / name
        made = path.with_name(f".{uuid.uuid4().hex}")
        if path.exists():
            return False
        with self._there():
            if path.parent != self.root:
                path.parent.mkdir(exist_ok=True)
            with made.open("x", encoding="utf-8") as file:
                file.write(text)
            try:
                os.link(made, path)
            except FileExistsError:
                return os.stat(made).st_nlink == 2  # a server's answer that was lost and repeated
            finally:
                made.unlink(missing_ok=True)
        return True

    def read(self, name: str) -> str | None:
        """The content of a file, None if there is none."""
        with suppress(FileNotFoundError):
            return (self.root / name).read_text(encoding="utf-8")
        self._check_there()
        return None

    def exists(self, name: str) -> bool:
        """Whether there is a file."""
        if (self.root / name).exists():
            return True
        self._check_there()
        return False

    def touch(self, name: str) -> None:
        """Set a file's time to now, by the file system's clock."""
        with self._there():
            os.utime(self.root / name)

    def age(self, name: str) -> float | None:
        """Time since a file was made or touched, both by the file system's clock, s.

        It is opened, for a file server's clients look up again only what is opened.
        """
        try:
            descriptor = os.open(self.root / name, os.O_RDONLY)
        except FileNotFoundError:
            self._check_there()
            return None
        try:
            return self._now() - os.fstat(descriptor).st_mtime
        finally:
            os.close(descriptor)

    def names(self, folder: str) -> list[str]:
        """Names in a folder; none if it is not there."""
        try:
            return [name for name in os.listdir(self.root / folder) if not name.startswith(".")]
        except FileNotFoundError:
            self._check_there()
            return []

    def close(self) -> None:
        """Remove what this process alone needed."""
        with suppress(OSError):
            self._clock.unlink(missing_ok=True)

    def _now(self) -> float:
        """The file system's time, which is asked for again from time to time.

        Where this process or its machine stood still in between, it is at worst too early.
        """
        asked = time.monotonic()
        if self._ahead is None or asked - self._asked > ASKED_EVERY:
            with self._there():
                self._clock.touch()
                os.utime(self._clock)
                self._ahead = self._clock.stat().st_mtime - asked
            self._asked = asked
        return self._ahead + asked

    def _check_there(self) -> None:
        if not self.root.is_dir():
            raise Gone(str(self.root))

    @contextmanager
    def _there(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            if error.errno in (errno.ENOENT, errno.ESTALE):
                raise Gone(str(self.root)) from None
            raise
