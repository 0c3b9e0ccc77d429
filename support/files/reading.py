"""Files of text and JSON that others may have damaged: bounded, checked, named in errors."""

from __future__ import annotations

import errno
import json
import os
import stat
from collections.abc import Mapping
from pathlib import Path
from typing import Any

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
        raise ValueError(f"{path} has more than {most} bytes, which no file of its kind has")
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
        raise ValueError(f"cannot read {path}: {error.strerror or error}; {remedy}") from None
    except ValueError as error:
        raise _damaged(path, error, remedy) from None


def parse_json(content: bytes) -> Any:
    """JSON whose numbers are finite and short, and whose objects and lists are not too deep.

    Raises:
        ValueError: for anything else.
    """
    try:
        parsed = json.loads(content, parse_int=_whole, parse_float=_finite, parse_constant=_finite)
    except RecursionError:
        raise ValueError(_TOO_DEEP) from None
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
        return checked_object(content, kinds)
    except ValueError as error:
        raise _damaged(path, error, remedy) from None


def checked_object(content: Any, kinds: Kinds) -> dict[str, Any]:
    """Parsed JSON that is an object with some keys; see :func:`read_object`.

    Raises:
        ValueError: if it is not, without the name of what holds it.
    """
    if not isinstance(content, dict):
        raise ValueError(f"it holds {_word(type(content))} where an object was expected")
    for name, kind in kinds.items():
        _check_kind(content, name, kind if isinstance(kind, tuple) else (kind,))
    return content


def _damaged(path: Path, error: ValueError, remedy: str) -> ValueError:
    return ValueError(f"{path} is damaged: {error}; {remedy}")


_TOO_DEEP = f"objects or lists are nested more than {DEEPEST} deep"


def _whole(text: str) -> int:
    if len(text) > MOST_DIGITS:
        raise ValueError(
            f"a whole number has {len(text)} digits, and at most {MOST_DIGITS} are read"
        )
    return int(text)


def _finite(text: str) -> float:
    number = float(text)
    if not abs(number) < float("inf"):
        raise ValueError(f"the number {text[:40]} is not finite")
    return number


def _check_depth(content: Any) -> None:
    level = [content]
    for _ in range(DEEPEST + 1):
        nested = [x for x in level if isinstance(x, dict | list)]
        if not nested:
            return
        level = [y for x in nested for y in (x.values() if isinstance(x, dict) else x)]
    raise ValueError(_TOO_DEEP)


def _check_kind(content: Mapping[str, Any], name: str, kinds: tuple[type, ...]) -> None:
    if name not in content:
        raise ValueError(f"it lacks {name!r}")
    value = content[name]
    taken = (*kinds, int) if float in kinds else kinds
    if not isinstance(value, taken) or (isinstance(value, bool) and bool not in kinds):
        expected = " or ".join(_word(kind) for kind in kinds)
        raise ValueError(f"{name!r} must be {expected}, got {_word(type(value))}")


def _word(kind: type) -> str:
    return _IN_WORDS.get(kind, kind.__name__)
