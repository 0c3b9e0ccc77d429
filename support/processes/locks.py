"""Files held by one process at a time."""

from __future__ import annotations

import os
from pathlib import Path

try:
    import fcntl
except ModuleNotFoundError:  # Windows: nothing is held there
    fcntl = None  # type: ignore[assignment]


class FileLock:
    """A file that one holder has at a time; released with the process, however it ends.

    Args:
        path: the file, in a folder that exists; it is there while it is held.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._descriptor: int | None = None

    def acquire(self, shared: bool = False) -> bool:
        """Hold it; False if somebody does, in this process or another.

        Args:
            shared: whether others may hold it too who ask for no more than that.
        """
        kind = None if fcntl is None else fcntl.LOCK_SH if shared else fcntl.LOCK_EX
        while True:
            descriptor = os.open(self.path, os.O_RDWR | os.O_CREAT, 0o644)
            try:
                if kind is not None:
                    fcntl.flock(descriptor, kind | fcntl.LOCK_NB)
                if self._is_the_file(descriptor):
                    self._descriptor, descriptor = descriptor, -1
                    return True
            except BlockingIOError:
                return False
            finally:
                if descriptor >= 0:
                    os.close(descriptor)

    def release(self) -> None:
        """Give it back, and remove the file unless others hold it; nothing if it is not held."""
        if self._descriptor is not None:
            if self._is_mine_alone(self._descriptor):
                self.path.unlink(missing_ok=True)
            os.close(self._descriptor)
            self._descriptor = None

    def _is_mine_alone(self, descriptor: int) -> bool:
        try:
            if fcntl is not None:
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
        return True

    def _is_the_file(self, descriptor: int) -> bool:
        """Whether the file has not been removed by a holder that gave it back in between."""
        try:
            return os.path.samestat(os.stat(self.path), os.fstat(descriptor))
        except FileNotFoundError:
            return False
