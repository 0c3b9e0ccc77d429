"""Objects of a store as small files that many processes share, and a store's faults in a sentence.

A store makes an object only if there is none of that name (`If-None-Match: *`), and replaces one
only if it is still what it was (`If-Match`). Claims rest on the first, signs of life on the second.
"""

from __future__ import annotations

import os
import time
import uuid
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

from ..packages.extras import load
from ..sharing.folder_files import Gone

ENDPOINTS = ("AWS_ENDPOINT_URL_S3", "AWS_ENDPOINT_URL", "AWS_ENDPOINT")
_ASKED_EVERY = 300.0
"""Time after which the store is asked for its time again, s."""

_MOST_TOLD = 200
"""Characters of a store's answer that are told."""


class StorageError(OSError):
    """A store that does not do what it is asked for, in one sentence."""


def opened_store(url: str) -> Any:
    """The store of obstore for ``s3://``, ``gs://`` or ``az://``, as the environment tells.

    Raises:
        ValueError: for a URL that names none.
        ModuleNotFoundError: without the extra, with the command that installs it.
    """
    stores, faults = load("obstore.store", "storage"), load("obstore.exceptions", "storage")
    try:
        return stores.from_url(url, **client_options())
    except (faults.BaseError, ValueError) as error:
        raise ValueError(f"{url} names no place in an object store: {_told(error)}") from None


def parquet_files(url: str, folder: str) -> tuple[Any, list[str]]:
    """A file system of fsspec, and the names on it of a place's Parquet files in a folder, sorted.

    Raises:
        ValueError: for a URL that names no place.
        StorageError: if the store does not answer.
        ModuleNotFoundError: without the extra, with the command that installs it.
    """
    scheme, _, place = url.partition("://")
    with asking(url):
        listed = load("obstore", "storage").list(opened_store(url), folder).collect()
    names = sorted(str(one["path"]) for one in listed)
    files = load("obstore.fsspec", "storage").FsspecStore(scheme, **client_options())
    return files, [f"{place.rstrip('/')}/{n}" for n in names if n.endswith(".parquet")]


def client_options() -> dict[str, Any]:
    """What the environment does not tell the client: whoever names a plain endpoint means it."""
    plain = any(os.environ.get(name, "").startswith("http://") for name in ENDPOINTS)
    return {"client_options": {"allow_http": True}} if plain else {}


@contextmanager
def asking(url: str) -> Iterator[None]:
    """Turn what obstore raises, but for what is there or is not, into one sentence."""
    faults = load("obstore.exceptions", "storage")
    try:
        yield
    except (faults.AlreadyExistsError, faults.PreconditionError, FileNotFoundError):
        raise
    except faults.BaseError as error:
        raise StorageError(
            f"{url} does not answer as a store that one may read and write: {_told(error)}; see "
            "that the bucket is there, and that the environment has credentials for it "
            "(AWS_ACCESS_KEY_ID, AWS_ENDPOINT_URL, …)"
        ) from None


def _told(error: Exception) -> str:
    text = " ".join(str(error).split())
    return text if len(text) <= _MOST_TOLD else f"{text[:_MOST_TOLD]}…"


class ObjectFiles:
    """Small files below a prefix of a store; see `SharedFiles`.

    Args:
        store: of obstore.
        url: of the place, for messages.
        prefix: before all names.
        ended: name of the object, from the store's root, that says that all is over; then
            :class:`Gone` is raised when names are asked for.
    """

    def __init__(self, store: Any, url: str, prefix: str, ended: str | None = None) -> None:
        self._obstore = load("obstore", "storage")
        self._faults = load("obstore.exceptions", "storage")
        self._store, self._url, self._prefix, self._ended = store, url, prefix, ended
        self._clock = f"{prefix}/.clock-{uuid.uuid4().hex}"
        self._ahead: float | None = None
        self._asked = 0.0
        self._made: dict[str, tuple[bytes, Any]] = {}

    def create(self, name: str, text: str) -> bool:
        """Make a file with all its content; False if there is one of that name.

        Every content is one of a kind: so the answer to a request that the client repeated, because
        the answer to the first was lost, can be told from another's having been faster.
        """
        content = f"{text}\n{uuid.uuid4().hex}".encode()
        with asking(self._url):
            try:
                made = self._obstore.put(self._store, self._at(name), content, mode="create")
            except self._faults.AlreadyExistsError:
                if self._content(name) != content:
                    return False
                made = self._obstore.head(self._store, self._at(name))
        self._made[name] = content, made
        return True

    def write(self, name: str, text: str) -> None:
        """Make a file or replace it, whoever made it."""
        with asking(self._url):
            self._obstore.put(self._store, self._at(name), f"{text}\n".encode())

    def read(self, name: str) -> str | None:
        """The content of a file, None if there is none."""
        content = self._content(name)
        return None if content is None else content.decode().rpartition("\n")[0]

    def exists(self, name: str) -> bool:
        """Whether there is a file."""
        return self._head(self._at(name)) is not None

    def touch(self, name: str) -> None:
        """Set a file's time to now, by the store's clock: it is replaced by itself.

        Raises:
            Gone: if it is not there, or is another.
        """
        content, held = self._made.get(name) or (self._content(name), self._head(self._at(name)))
        if content is None or held is None:
            raise Gone(f"{self._url}/{self._at(name)}")
        mode = {key: held[key] for key in ("e_tag", "version") if held.get(key) is not None}
        with asking(self._url):
            try:
                made = self._obstore.put(self._store, self._at(name), content, mode=mode)
            except (self._faults.PreconditionError, FileNotFoundError):
                self._made.pop(name, None)
                raise Gone(f"{self._url}/{self._at(name)}") from None
        self._made[name] = content, made

    def age(self, name: str) -> float | None:
        """Time since a file was made or touched, both by the store's clock, s; to a second."""
        made = self.time_of(name)
        return None if made is None else self.now() - made

    def time_of(self, name: str) -> float | None:
        """Unix time when a file was made or touched, by the store's clock, s; to a second."""
        found = self._head(self._at(name))
        return None if found is None else float(found["last_modified"].timestamp())

    def names(self, folder: str) -> list[str]:
        """Names in a folder; none if it is not there.

        Raises:
            Gone: if all is over.
        """
        if self._ended is not None and self._head(self._ended) is not None:
            raise Gone(f"{self._url}/{self._ended}")
        at = self._at(folder)
        with asking(self._url):
            found = self._obstore.list_with_delimiter(self._store, at)["objects"]
        names = (str(one["path"]).rpartition("/")[2] for one in found)
        return [name for name in names if not name.startswith(".")]

    def close(self) -> None:
        """Remove what this process alone needed."""
        with suppress(OSError):
            self._obstore.delete(self._store, self._clock)

    def _at(self, name: str) -> str:
        return f"{self._prefix}/{name}".rstrip("/")

    def _content(self, name: str) -> bytes | None:
        with asking(self._url):
            try:
                return bytes(self._obstore.get(self._store, self._at(name)).bytes())
            except FileNotFoundError:
                return None

    def _head(self, name: str) -> Any | None:
        with asking(self._url):
            try:
                return self._obstore.head(self._store, name)
            except FileNotFoundError:
                return None

    def now(self) -> float:
        """The store's Unix time, s; it is asked for again from time to time, see `FolderFiles`."""
        asked = time.monotonic()
        if self._ahead is None or asked - self._asked > _ASKED_EVERY:
            with asking(self._url):
                self._obstore.put(self._store, self._clock, b"")
            found = self._head(self._clock)
            assert found is not None
            self._ahead = float(found["last_modified"].timestamp()) - asked
            self._asked = asked
        return self._ahead + asked
