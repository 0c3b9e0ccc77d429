"""Files: written whole or not at all, and read with one sentence on what is wrong."""

from __future__ import annotations

import errno
import hashlib
import json
import os
import shutil
import stat
import time
import uuid
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from .errors import InputError

Kinds = Mapping[str, type | tuple[type, ...]]
"""Key of an object to what its value must be; ``float`` takes whole numbers too."""

MOST_BYTES = 16 << 20
"""A file of text beyond this is none of ours."""

MOST_DIGITS = 80
"""Of a whole number; seeds of 256 bits have 78."""

DEEPEST = 64
"""Objects and lists within each other."""

_IN_WORDS = {
    str: "text", float: "a number", int: "a whole number", bool: "true or false", list: "a list",
    dict: "an object", type(None): "null",
}  # fmt: skip


def check_regular(path: Path) -> None:
    """Check that a path is a file with an end: no folder, no device, no pipe.

    Raises:
        OSError: if not.
    """
    kind = path.stat().st_mode
    if stat.S_ISDIR(kind):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    if not stat.S_ISREG(kind):
        raise OSError(errno.EINVAL, "it is a device or a pipe and no file", str(path))


def read_bounded(path: Path, most: int = MOST_BYTES) -> bytes:
    """The content of a file.

    Raises:
        OSError: if it cannot be read, or is a device or a pipe.
        ValueError: if it has more than ``most`` bytes, which are all that is read.
    """
    check_regular(path)
    with path.open("rb") as file:
        content = file.read(most + 1)
    if len(content) > most:
        raise InputError(f"{path} has more than {most} bytes, which no file of its kind has")
    return content


def read_json(path: Path, remedy: str) -> Any:
    """What a JSON file holds.

    Args:
        path: the file.
        remedy: what helps where it is damaged, as the end of a sentence.

    Raises:
        ValueError: in one sentence that names the file, the fault and the remedy.
    """
    try:
        return parse_json(read_bounded(path))
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}; {remedy}") from None
    except ValueError as error:
        raise _damage_error(path, error, remedy) from None


def parse_json(content: bytes) -> Any:
    """JSON whose numbers are finite and short, and whose objects and lists are not too deep.

    Raises:
        ValueError: for anything else.
    """
    try:
        parsed = json.loads(content, parse_int=_whole, parse_float=_finite, parse_constant=_finite)
    except RecursionError:
        raise InputError(_TOO_DEEP) from None
    _check_depth(parsed)
    return parsed


def read_object(path: Path, kinds: Kinds, remedy: str) -> dict[str, Any]:
    """A JSON object with some keys.

    Args:
        path: the file.
        kinds: keys that it must have, and what their values must be; it may have others.
        remedy: see :func:`read_json`.

    Raises:
        ValueError: in one sentence that names the file, the fault and the remedy.
    """
    content = read_json(path, remedy)
    try:
        return check_object(content, kinds)
    except ValueError as error:
        raise _damage_error(path, error, remedy) from None


def check_object(content: Any, kinds: Kinds) -> dict[str, Any]:
    """Parsed JSON that is an object with some keys; see :func:`read_object`.

    Raises:
        ValueError: if it is not, without the name of what holds it.
    """
    if not isinstance(content, dict):
        raise InputError(f"it holds {_word(type(content))} where an object was expected")
    for name, kind in kinds.items():
        _check_kind(content, name, kind if isinstance(kind, tuple) else (kind,))
    return content


def _damage_error(path: Path, error: ValueError, remedy: str) -> InputError:
    return InputError(f"{path} is damaged: {error}; {remedy}")


_TOO_DEEP = f"objects or lists are nested more than {DEEPEST} deep"


def _whole(text: str) -> int:
    if len(text) > MOST_DIGITS:
        raise InputError(
            f"a whole number has {len(text)} digits, and at most {MOST_DIGITS} are read"
        )
    return int(text)


def _finite(text: str) -> float:
    number = float(text)
    if not abs(number) < float("inf"):
        raise InputError(f"the number {text[:40]} is not finite")
    return number


def _check_depth(content: Any) -> None:
    level = [content]
    for _ in range(DEEPEST + 1):
        nested = [x for x in level if isinstance(x, dict | list)]
        if not nested:
            return
        level = [y for x in nested for y in (x.values() if isinstance(x, dict) else x)]
    raise InputError(_TOO_DEEP)


def _check_kind(content: Mapping[str, Any], name: str, kinds: tuple[type, ...]) -> None:
    if name not in content:
        raise InputError(f"it lacks {name!r}")
    value = content[name]
    taken = (*kinds, int) if float in kinds else kinds
    if not isinstance(value, taken) or (isinstance(value, bool) and bool not in kinds):
        expected = " or ".join(_word(kind) for kind in kinds)
        raise InputError(f"{name!r} must be {expected}, got {_word(type(value))}")


def _word(kind: type) -> str:
    return _IN_WORDS.get(kind, kind.__name__)


_SUFFIX = ".tmp"

LEFTOVER_AGE = 3600.0
"""A temporary file not written to for so long was left by a killed writer, s."""


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
    with _temporary(path) as temporary:
        write(temporary)
        _synchronise(temporary)
        _publish(temporary, path)


@contextmanager
def _temporary(path: Path) -> Iterator[Path]:
    """A path beside another, removed at the end; then the folder is flushed to the disk."""
    temporary = path.with_name(f".{path.name}.{uuid.uuid4().hex}{_SUFFIX}")
    try:
        yield temporary
    finally:
        if temporary.is_dir():
            shutil.rmtree(temporary)
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
    with _temporary(path) as temporary:
        yield temporary
        if path.exists():
            raise FileExistsError(str(path))
        temporary.rename(path)


def replace_file(path: Path, content: bytes) -> Path:
    """Write a file in one step: a reader sees the old one or the new one, never a part."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with _temporary(path) as temporary:
        temporary.write_bytes(content)
        _synchronise(temporary)
        os.replace(temporary, path)
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
        age: since when they have not been written to, s; 0 where no other process writes.
    """
    for file in directory.glob(f".*{_SUFFIX}"):
        with suppress(FileNotFoundError):
            if time.time() - file.stat().st_mtime >= age:
                file.unlink()


def display_path(path: str | os.PathLike[str]) -> str:
    """A path as others will read it: relative to here, and of one elsewhere the name alone.

    A URL is left as it is.
    """
    if "://" in str(path):
        return str(path)
    full = Path(path)
    if not full.is_absolute():
        return str(full)
    here = Path.cwd()
    return str(full.relative_to(here)) if full.is_relative_to(here) else full.name


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


def cannot_write(out: Path, error: OSError) -> InputError:
    """What to raise where writing under ``out`` failed."""
    return InputError(f"cannot write to {out}: {error.strerror or error}; give another --out")


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
