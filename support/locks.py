"""A lock on a file, which the operating system takes back from a process that ends."""

from __future__ import annotations

import os
import sys
from contextlib import suppress
from pathlib import Path

from .optional import missing_package

try:
    from portalocker import AlreadyLocked, LockException, LockFlags, lock, unlock
except ModuleNotFoundError as error:
    raise missing_package(str(error.name), "evidence") from error


class FileLock:
    """A file that one holder has at a time; released with the process, however it ends.

    On Windows others cannot read it while it is held.

    Args:
        path: the file, in a folder that exists; it is there while it is held.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._descriptor: int | None = None

    def acquire(self, text: str = "") -> bool:
        """Hold it; False if somebody does, in this process or another.

        Args:
            text: written to the file, for whoever finds it held.

        Raises:
            OSError: if it cannot be made, or its file system knows no locks.
        """
        while True:
            descriptor = os.open(self.path, os.O_RDWR | os.O_CREAT, 0o644)
            try:
                if not _lock(descriptor):
                    return False
                if self._is_the_file(descriptor):
                    with suppress(OSError):  # a full disk: it is held all the same
                        os.ftruncate(descriptor, 0)
                        os.write(descriptor, text.encode())
                    self._descriptor, descriptor = descriptor, -1
                    return True
            finally:
                if descriptor >= 0:
                    os.close(descriptor)

    def read(self) -> str:
        """What its holder wrote; empty where it cannot be read."""
        with suppress(OSError):
            return self.path.read_text(encoding="utf-8")
        return ""

    def release(self) -> None:
        """Give it back, and remove the file; nothing if it is not held."""
        descriptor, self._descriptor = self._descriptor, None
        if descriptor is None:
            return
        if sys.platform == "win32":  # where a file that somebody has open is not removed
            unlock(descriptor)
            os.close(descriptor)
            with suppress(PermissionError):
                self.path.unlink(missing_ok=True)
            return
        self.path.unlink(missing_ok=True)
        os.close(descriptor)

    def _is_the_file(self, descriptor: int) -> bool:
        """Whether the file has not been removed by a holder that gave it back in between."""
        try:
            return os.path.samestat(os.stat(self.path), os.fstat(descriptor))
        except FileNotFoundError:
            return False


def _lock(descriptor: int) -> bool:
    """Lock an open file; False if somebody else holds it.

    Raises:
        OSError: if it can be held by nobody.
    """
    try:
        lock(descriptor, LockFlags.EXCLUSIVE | LockFlags.NON_BLOCKING)
    except AlreadyLocked:
        return False
    except LockException as error:
        raise OSError(f"files cannot be locked here: {error}; give another directory") from error
    return True
