"""Whether claims can hold in a directory: its file system is tried before anything rests on it."""

from __future__ import annotations

import os
import shutil
import threading
import time
import uuid
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from ..processes.locks import FileLock
from .folder_files import FolderFiles

PROBE = ".probe-"
"""How the name of a folder begins in which something is tried; who is killed there leaves it."""

ROUNDS, RIVALS = 8, 4
"""How often several threads try to make one file, and how many."""

_TICK = 0.05
"""Time that the file system's clock is watched for, s."""


def check_sharing(folder: Path) -> None:
    """Check that a directory's file system keeps what claims rest on.

    A file is made by one of several that try, a renaming replaces in one step, a lock is held by
    one process at a time, and files have times that advance. What only several machines together
    could show is not seen: two clients of a file server that each keep what the other changed.

    Raises:
        ValueError: in one sentence, if not.
    """
    tried = folder / f"{PROBE}{uuid.uuid4().hex}"
    tried.mkdir(parents=True)
    try:
        for fault, holds in _CHECKS.items():
            if not _holds(holds, tried):
                raise ValueError(
                    f"{folder} lies on a file system that cannot be shared: {fault}; give a "
                    "directory on another one, or give an engine with --executor in place of "
                    "--worker"
                )
    finally:
        shutil.rmtree(tried, ignore_errors=True)


def _holds(check: Callable[[Path], bool], folder: Path) -> bool:
    try:
        return check(folder)
    except OSError:
        return False


def _one_makes_a_file(folder: Path) -> bool:
    """Of several that make files of one name, one alone is told that it did, and its text stays."""
    if not _link_refuses(folder):
        return False
    with ThreadPoolExecutor(RIVALS) as pool:
        for number in range(ROUNDS):
            start = threading.Barrier(RIVALS)
            tries = [pool.submit(_try, folder, str(number), str(k), start) for k in range(RIVALS)]
            won = [str(rival) for rival, one in enumerate(tries) if one.result()]
            if won != [FolderFiles(folder).read(str(number))]:
                return False
    return True


def _link_refuses(folder: Path) -> bool:
    """Whether a link takes no other file's name."""
    first, second, name = (folder / text for text in ("first", "second", "named"))
    for file in (first, second):
        file.write_text(file.name, encoding="utf-8")
    os.link(first, name)
    try:
        os.link(second, name)
    except FileExistsError:
        return name.read_text(encoding="utf-8") == first.name
    return False


def _try(folder: Path, name: str, text: str, start: threading.Barrier) -> bool:
    start.wait()
    return FolderFiles(folder).create(name, text)


def _renaming_replaces(folder: Path) -> bool:
    """A file moved over another takes its place, and is no longer where it was."""
    old, new = folder / "old", folder / "new"
    old.write_text("old", encoding="utf-8")
    new.write_text("new", encoding="utf-8")
    os.replace(new, old)
    return old.read_text(encoding="utf-8") == "new" and not new.exists()


def _one_holds_a_lock(folder: Path) -> bool:
    first, second = FileLock(folder / "lock"), FileLock(folder / "lock")
    try:
        return first.acquire() and not second.acquire()
    finally:
        first.release()
        second.release()


def _times_advance(folder: Path) -> bool:
    files = FolderFiles(folder)
    files.create("aged", "")
    time.sleep(_TICK)
    age = files.age("aged")
    files.touch("aged")
    renewed = files.age("aged")
    files.close()
    return age is not None and renewed is not None and age > 0.0 and renewed <= age


_CHECKS: dict[str, Callable[[Path], bool]] = {
    "two processes can make one file there": _one_makes_a_file,
    "a renamed file does not take another's place there": _renaming_replaces,
    "locks do not hold there": _one_holds_a_lock,
    "files have no times that advance there": _times_advance,
}
"""What is wrong with a file system to what shows that it is not."""
