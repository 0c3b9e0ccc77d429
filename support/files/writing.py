"""Files that appear whole or not at all, and the folder of ``--out``."""

from __future__ import annotations

import errno
import hashlib
import json
import os
import shutil
import time
import uuid
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

_SUFFIX = ".tmp"

LEFTOVER_AGE = 3600.0
"""A temporary file that nobody has written to for so long was left by a killed writer, s."""


def write_once(path: Path, write: Callable[[Path], None]) -> None:
    """Write a new file so that it becomes visible in one step.

    Args:
        path: the file.
        write: writes the content to the temporary path that it is given.

    Raises:
        FileExistsError: if the file exists; it is left as it is.
    """
    if path.exists():
        raise FileExistsError(str(path))
    temporary = path.with_name(f".{path.name}.{uuid.uuid4().hex}{_SUFFIX}")
    try:
        write(temporary)
        _synchronise(temporary)
        _publish(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)
    _synchronise(path.parent)


@contextmanager
def new_path(path: Path) -> Iterator[Path]:
    """A path beside another, for a file or folder that gets its name once all is in it.

    Raises:
        FileExistsError: if there is something of that name; it is left as it is.
        OSError: if nothing can be written there.
    """
    if path.exists():
        raise FileExistsError(str(path))
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name}.{uuid.uuid4().hex}{_SUFFIX}")
    try:
        yield temporary
        if path.exists():
            raise FileExistsError(str(path))
        temporary.rename(path)
    finally:
        if temporary.is_dir():
            shutil.rmtree(temporary)
        temporary.unlink(missing_ok=True)
    _synchronise(path.parent)


def replace_file(path: Path, content: bytes) -> Path:
    """Write a file in one step: a reader sees the old one or the new one, never a part."""
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name}.{uuid.uuid4().hex}{_SUFFIX}")
    try:
        temporary.write_bytes(content)
        _synchronise(temporary)
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)
    _synchronise(path.parent)
    return path


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Write JSON in one step: the file is there whole or not at all."""
    text = json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False)
    replace_file(path, f"{text}\n".encode())


def file_hash(path: Path) -> str:
    """SHA-256 of a file's content, 64 hexadecimal digits."""
    with path.open("rb") as content:
        return hashlib.file_digest(content, "sha256").hexdigest()


def remove_leftovers(directory: Path, age: float = LEFTOVER_AGE) -> None:
    """Remove temporary files that killed writers left behind.

    Args:
        directory: where.
        age: since when they have not been written to, s; 0 where nobody else writes.
    """
    for file in directory.glob(f".*{_SUFFIX}"):
        with suppress(FileNotFoundError):
            if time.time() - file.stat().st_mtime >= age:
                file.unlink()


def told_path(path: str | os.PathLike[str]) -> str:
    """A path as what others will read tells it: from here, and of one elsewhere the name alone.

    A URL is told as it is.
    """
    if "://" in str(path):
        return str(path)
    told = Path(path)
    if not told.is_absolute():
        return str(told)
    here = Path.cwd()
    return str(told.relative_to(here)) if told.is_relative_to(here) else told.name


def read_files(folder: Path) -> dict[str, bytes]:
    """The files in and below a folder, by their names in it with ``/``; none if it is not there."""
    found = sorted(path for path in folder.rglob("*") if path.is_file())
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in found}


def write_files(folder: Path, files: Mapping[str, bytes]) -> None:
    """Write files into a folder, in the order that is given, each in one step."""
    for name, content in files.items():
        replace_file(folder / name, content)


def make_folder(out: Path) -> Path:
    """``out`` as a folder that can be written to, made where there is none.

    Raises:
        ValueError: where it cannot be, with the remedy.
    """
    try:
        out.mkdir(parents=True, exist_ok=True)
        if not os.access(out, os.W_OK | os.X_OK):
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
    except OSError as error:
        raise cannot_write(out, error) from None
    return out


def cannot_write(out: Path, error: OSError) -> ValueError:
    """What to raise where writing under ``out`` failed."""
    return ValueError(f"cannot write to {out}: {error.strerror or error}; give another --out")


def _publish(temporary: Path, path: Path) -> None:
    """Give the file its name; a link, unlike a renaming, never replaces another file."""
    try:
        os.link(temporary, path)
    except FileExistsError:
        raise
    except OSError:  # a file system without links
        if path.exists():
            raise FileExistsError(str(path)) from None
        os.replace(temporary, path)


def _synchronise(path: Path) -> None:
    """Flush a file, or the entries of a directory, to the disk."""
    if os.name == "nt" and path.is_dir():
        return
    descriptor = os.open(path, os.O_RDONLY if path.is_dir() else os.O_RDWR)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
