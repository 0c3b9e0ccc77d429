"""What a run needs of the place that its files are kept in, and a folder as such a place.

A folder is worked on where it is. What is kept elsewhere is worked on in a copy on this machine,
which follows the place when it is told to, and whose new files are sent there.
"""

from __future__ import annotations

import os
import shutil
import time
import uuid
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager, suppress
from pathlib import Path
from typing import Protocol

from ..processes.locks import FileLock
from ..sharing.claims import LEASE
from ..sharing.folder_files import FolderFiles, Gone, SharedFiles
from ..sharing.probing import check_sharing

LOCK = ".lock"
_GONE = "gone-"
_TRIES, _BETWEEN_TRIES = 20, 0.1
"""To share a lock; time between them, s."""


class Busy(Exception):
    """Somebody else works there."""


class Storage(Protocol):
    """What a run needs; names are relative to it, with ``/`` between their parts."""

    path: Path
    """Folder on this machine in which its files are worked on."""

    remote: bool
    """Whether that is a copy."""

    def check(self) -> None:
        """Try what several processes rest on.

        Raises:
            ValueError: in one sentence, if it does not hold.
        """
        ...

    def held(self, alone: bool, lease: float = LEASE) -> AbstractContextManager[str | None]:
        """Keep it for one that works there alone, or for any number who work there together.

        Yields a name of its own for what is done there meanwhile; None where none is needed,
        because what others began can be ended in one step.

        Args:
            alone: whether nobody else may work there.
            lease: time of silence after which whoever works there is taken for dead, s.

        Raises:
            Busy: if somebody does who does not let others.
        """
        ...

    def shared(self, folder: str, within: str = "") -> SharedFiles:
        """Small files of a folder that many processes share.

        Args:
            folder: the folder; made where it is below another that is there.
            within: the folder whose end is theirs; see :meth:`end`.

        Raises:
            Gone: if that was ended.
        """
        ...

    def folders(self, folder: str) -> list[str]:
        """Names of the folders in a folder."""
        ...

    def files(self, folder: str) -> list[str]:
        """Names of all files in and below a folder, from the place's root; hidden ones left out."""
        ...

    def move(self, names: Mapping[str, str]) -> None:
        """Have files take others' places; nothing happens to those that are not there any more."""
        ...

    def remove(self, folder: str) -> None:
        """Remove a folder with all that is in it."""
        ...

    def end(self, folder: str, fences: Callable[[str], bool]) -> None:
        """Remove a folder in which somebody may still work, unseen.

        Args:
            folder: the folder.
            fences: whether a file, by its name in it, is what keeps such a one from deciding.
        """
        ...

    def vanish(self, folder: str) -> str | None:
        """Take a folder away from all who work in it, by one step; where it is from now on.

        None where that cannot be done.
        """
        ...

    def vanished(self, folder: str) -> list[str]:
        """What folders beside it were taken away and not yet removed."""
        ...

    def fetch(self, *names: str) -> None:
        """Have the copy follow: these files and, with ``/`` at their end, folders; else all."""
        ...

    def keep(self, *folders: str) -> None:
        """Send the new files of these folders of the copy, in that order; none is replaced."""
        ...

    def publish(self, name: str) -> None:
        """Send a file of the copy, new or in place of that which was fetched.

        Raises:
            Busy: if it was changed meanwhile.
        """
        ...

    def changed(self) -> list[str]:
        """Files of the copy that are not what was fetched; hidden ones left out."""
        ...

    def drop_missing(self) -> None:
        """Remove what was fetched, is not in the copy any more, and was not changed meanwhile."""
        ...


class FolderStorage:
    """A folder of a disk or a file server.

    Args:
        path: the folder.
    """

    remote = False

    def __init__(self, path: Path) -> None:
        self.path = path

    def __str__(self) -> str:
        return str(self.path)

    def check(self) -> None:
        """See :class:`Storage`."""
        check_sharing(self.path)

    @contextmanager
    def held(self, alone: bool, lease: float = LEASE) -> Iterator[None]:
        """See :class:`Storage`; by a lock, which ends with the process."""
        lock = FileLock(self.path / LOCK)
        if not (lock.acquire() if alone else _held_soon(lock)):
            raise Busy
        try:
            yield
        finally:
            lock.release()

    def shared(self, folder: str, within: str = "") -> FolderFiles:
        """See :class:`Storage`; these vanish with the folder."""
        if folder != within:
            try:
                (self.path / folder).mkdir(exist_ok=True)
            except FileNotFoundError:
                raise Gone(str(self.path / folder)) from None
        return FolderFiles(self.path / folder)

    def folders(self, folder: str) -> list[str]:
        """See :class:`Storage`."""
        return sorted(entry.name for entry in (self.path / folder).glob("*") if entry.is_dir())

    def files(self, folder: str) -> list[str]:
        """See :class:`Storage`."""
        found = sorted((self.path / folder).rglob("*"))
        shown = (file for file in found if file.is_file() and not file.name.startswith("."))
        return [file.relative_to(self.path).as_posix() for file in shown]

    def move(self, names: Mapping[str, str]) -> None:
        """See :class:`Storage`."""
        for name, to in names.items():
            target = self.path / to
            target.parent.mkdir(parents=True, exist_ok=True)
            with suppress(FileNotFoundError):  # somebody else was faster
                os.replace(self.path / name, target)

    def remove(self, folder: str) -> None:
        """See :class:`Storage`."""
        shutil.rmtree(self.path / folder, ignore_errors=True)

    def end(self, folder: str, fences: Callable[[str], bool]) -> None:
        """See :class:`Storage`; where there is no folder, nothing can be made in it."""
        self.remove(folder)

    def vanish(self, folder: str) -> str | None:
        """See :class:`Storage`; by renaming."""
        path = self.path / folder
        gone = path.with_name(f"{_GONE}{uuid.uuid4().hex}")
        with suppress(FileNotFoundError):
            path.rename(gone)
        return gone.relative_to(self.path).as_posix()

    def vanished(self, folder: str) -> list[str]:
        """See :class:`Storage`."""
        gone = (self.path / folder).parent.glob(f"{_GONE}*")
        return sorted(path.relative_to(self.path).as_posix() for path in gone)

    def fetch(self, *names: str) -> None:
        """Nothing: the folder is worked on where it is."""

    def keep(self, *folders: str) -> None:
        """Nothing: the folder is worked on where it is."""

    def publish(self, name: str) -> None:
        """Nothing: the folder is worked on where it is."""

    def changed(self) -> list[str]:
        """None: the folder is worked on where it is."""
        return []

    def drop_missing(self) -> None:
        """Nothing: the folder is worked on where it is."""


def _held_soon(lock: FileLock) -> bool:
    """Share a lock; one of those that share it may hold it alone for a moment as it leaves."""
    for _ in range(_TRIES):
        if lock.acquire(shared=True):
            return True
        time.sleep(_BETWEEN_TRIES)
    return False
