"""A place as a user names it: a folder of this machine, or a URL."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from urllib.parse import unquote, urlsplit

from .storage import FolderStorage, Storage

Place = str | os.PathLike[str]
"""A folder, or a URL."""

SCHEMES = ("s3", "gs", "az")
"""Of object stores."""

_SCHEME = re.compile(r"([A-Za-z][A-Za-z0-9+.-]*):/")


def is_remote(place: Place | Storage) -> bool:
    """Whether a place is in an object store."""
    return str(place).partition("://")[0] in SCHEMES


def named_place(place: Place) -> str | Path:
    """A place as it is worked with: the URL of one in an object store, else the path.

    Raises:
        ValueError: for a URL of another kind.
    """
    text = str(place)
    scheme = _SCHEME.match(text)
    if scheme is None or (os.name == "nt" and len(scheme[1]) == 1):
        return Path(place)
    if scheme[1] == "file" and text.startswith("file:///"):
        return Path(unquote(urlsplit(text).path))
    if scheme[1] in SCHEMES and re.match(r"\w+://[^/]+/.", text):
        return text.rstrip("/")
    kinds = ", ".join(f"{name}://BUCKET/RUN" for name in SCHEMES)
    raise ValueError(f"{text} is no place for a run; give a folder, file:///FOLDER, or {kinds}")


def as_storage(place: Path | Storage) -> Storage:
    """A folder as a place; a place as it is."""
    return FolderStorage(place) if isinstance(place, Path) else place


@contextmanager
def stored(place: Place) -> Iterator[Storage]:
    """A place by its name; a copy that is worked on goes with the block.

    Raises:
        ValueError: for a name of none.
        ModuleNotFoundError: without the extra, with the command that installs it.
    """
    named = named_place(place)
    with ExitStack() as stack:
        if isinstance(named, Path):
            yield FolderStorage(named)
        else:
            from .bucket import BucketStorage

            yield stack.enter_context(BucketStorage(named))


@contextmanager
def fetched(place: Place) -> Iterator[Path]:
    """A run as a folder of this machine: where it is, or a copy that goes with the block.

    Raises:
        ValueError: for a name of no place, or of one in which nothing is.
        ModuleNotFoundError: without the extra, with the command that installs it.
    """
    with stored(place) as storage:
        storage.fetch()
        if storage.remote and not any(storage.path.iterdir()):
            raise ValueError(f"{storage} holds no run; give the place that one was written to")
        yield storage.path
