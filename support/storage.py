"""Where a run is kept: a folder of this machine, or a place in an object store.

A place in a store is worked on in a copy on this machine. What is new in the copy is sent there as
units are finished, and a run goes on from what is there. One driver at a time works in a place: it
holds a lock file that names it.
"""

from __future__ import annotations

import json
import os
import re
import socket
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from urllib.parse import unquote, urlsplit

from .errors import InputError, IntegGymError
from .optional import load

Place = str | os.PathLike[str]
"""A folder, or a URL."""

SCHEMES = ("s3", "gs", "az")
"""Of object stores."""

LOCK = ".lock"

ENDPOINTS = ("AWS_ENDPOINT_URL_S3", "AWS_ENDPOINT_URL", "AWS_ENDPOINT")

_SCHEME = re.compile(r"([A-Za-z][A-Za-z0-9+.-]*):/")
_MOST_TEXT = 200
"""Characters of a store's answer that are shown."""

_LAST = ("units", "seal.json")
"""Folders and files that say that others are complete: they are sent last and removed first."""


class StorageError(IntegGymError, OSError):
    """A store that does not do what it is asked for, in one sentence."""


class BusyError(Exception):
    """Another driver works there; who, since when and what to do, in one sentence."""


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
            text: written to the file, for a process that finds it held.

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
            load("portalocker", "evidence").unlock(descriptor)
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
        OSError: if it cannot be held.
    """
    locks = load("portalocker", "evidence")
    try:
        locks.lock(descriptor, locks.LockFlags.EXCLUSIVE | locks.LockFlags.NON_BLOCKING)
    except locks.AlreadyLocked:
        return False
    except locks.LockException as error:
        raise OSError(f"files cannot be locked here: {error}; give another directory") from error
    return True


class Storage:
    """A folder of this machine in which a run is worked on.

    Args:
        path: the folder.
    """

    remote = False

    def __init__(self, path: Path) -> None:
        self.path = path

    def __str__(self) -> str:
        return str(self.path)

    def __reduce__(self) -> tuple[Any, ...]:
        return Storage, (self.path,)  # another process works in the folder and sends nothing

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Hold the run for one driver; released with the process, however it ends.

        Raises:
            BusyError: if another driver holds it.
        """
        lock = FileLock(self.path / LOCK)
        if not lock.acquire(holder_text()):
            raise BusyError(
                f"{_format_holder(lock.read())} is running the panel in {self}; wait for it, or "
                "give another directory with --out"
            )
        try:
            yield
        finally:
            lock.release()

    def names(self) -> list[str]:
        """Files of the run in the store; none of a folder, which is looked at where it is."""
        return []

    def fetch(self, *names: str) -> None:
        """Have these files, by default all, be as they are in the store."""

    def send(self) -> None:
        """Send what is new or was changed, and remove what is gone."""


class StoredRun(Storage):
    """A place in an object store, and a copy of it in a temporary folder that goes with the block.

    Args:
        url: ``s3://BUCKET/PREFIX``, ``gs://…`` or ``az://…``.
        path: the folder.

    Raises:
        ValueError: for another URL.
        ModuleNotFoundError: without the extra, with the command that installs it.
    """

    remote = True

    def __init__(self, url: str, path: Path) -> None:
        super().__init__(path)
        self.url = url
        self._obstore = load("obstore", "storage")
        self._store = _open_store(url)
        self._files = _file_system(url)
        self._root = url.partition("://")[2]
        self._sent: dict[str, tuple[int, int]] = {}

    def __str__(self) -> str:
        return self.url

    @contextmanager
    def locked(self) -> Iterator[None]:
        """See `Storage`; a driver that is killed leaves its lock, which must be removed by hand
        unless it ran on this machine.

        Raises:
            BusyError: if another driver holds it.
        """
        exists, own = load("obstore.exceptions", "storage").AlreadyExistsError, holder_text()
        with wrap_store_errors(self.url):
            for _ in range(2):
                try:
                    self._obstore.put(self._store, LOCK, own.encode(), mode="create")
                    break
                except exists:
                    self._check_holder()
            else:
                raise BusyError(f"other processes are starting in {self.url}; try again")
        try:
            yield
        finally:
            with wrap_store_errors(self.url):
                if self._lock_text() == own:
                    self._obstore.delete(self._store, LOCK)

    def _lock_text(self) -> str:
        """What the lock says; empty where there is none."""
        with suppress(FileNotFoundError):
            return bytes(self._obstore.get(self._store, LOCK).bytes()).decode()
        return ""

    def _check_holder(self) -> None:
        """Remove the lock of a process of this machine that is gone.

        Raises:
            BusyError: if it is another's.
        """
        text = self._lock_text()
        if not text:
            return
        holder = _read_holder(text)
        if holder.get("host") == socket.gethostname() and not _is_alive(holder.get("process")):
            self._obstore.delete(self._store, LOCK)
            return
        raise BusyError(
            f"{_format_holder(text)} is running the panel in {self.url}; wait for it, or, if it "
            f"was killed, remove {self.url}/{LOCK} and run this again"
        )

    def fetch(self, *names: str) -> None:
        """See `Storage`."""
        with wrap_store_errors(self.url):
            wanted = [name for name in self.names() if not names or name in names]
            targets = [self.path / name for name in wanted]
            for target in targets:
                target.parent.mkdir(parents=True, exist_ok=True)
            if wanted:
                self._files.get([f"{self._root}/{n}" for n in wanted], [str(t) for t in targets])
        self._sent |= {n: _stamp(target) for n, target in zip(wanted, targets, strict=True)}

    def send(self) -> None:
        """See `Storage`."""
        names = self._local_names()
        with wrap_store_errors(self.url):
            gone = sorted((name for name in self._sent if name not in names), key=_is_last)
            for name in reversed(gone):
                self._remove(name)
            changed = {n: stamp for n, stamp in names.items() if self._sent.get(n) != stamp}
            for last in (0, 1, 2):
                part = [name for name in changed if _is_last(name) == last]
                if part:
                    sources = [str(self.path / name) for name in part]
                    self._files.put(sources, [f"{self._root}/{name}" for name in part])
        self._sent |= changed

    def _remove(self, name: str) -> None:
        with suppress(FileNotFoundError):
            self._obstore.delete(self._store, name)
        del self._sent[name]

    def names(self) -> list[str]:
        """See `Storage`."""
        with wrap_store_errors(self.url):
            found = self._obstore.list(self._store).collect()
        return [name for name in (str(one["path"]) for one in found) if not _is_hidden(name)]

    def _local_names(self) -> dict[str, tuple[int, int]]:
        """Files of the copy; markers are listed first, so that what they rest on is listed too."""
        folder = _LAST[0]
        markers = self._list(self.path / folder)
        found = self._list(self.path)
        return {n: x for n, x in found.items() if not n.startswith(f"{folder}/")} | markers

    def _list(self, folder: Path) -> dict[str, tuple[int, int]]:
        found = {}
        for path in folder.rglob("*"):
            name = path.relative_to(self.path).as_posix()
            with suppress(FileNotFoundError):  # somebody's temporary one
                if not _is_hidden(name) and path.is_file():
                    found[name] = _stamp(path)
        return found


@contextmanager
def open_storage(place: Place | Storage) -> Iterator[Storage]:
    """A place by its name; a copy that is worked on goes with the block.

    Raises:
        ValueError: for a name of none.
        ModuleNotFoundError: without the extra, with the command that installs it.
    """
    if isinstance(place, Storage):
        yield place
        return
    location = resolve_place(place)
    if isinstance(location, Path):
        yield Storage(location)
        return
    with TemporaryDirectory(prefix="integ-gym-run-", ignore_cleanup_errors=True) as folder:
        yield StoredRun(location, Path(folder))


@contextmanager
def local_copy(place: Place) -> Iterator[Path]:
    """A run as a folder of this machine: where it is, or a copy that goes with the block.

    Raises:
        ValueError: for a name of no place, or of one in which nothing is.
        ModuleNotFoundError: without the extra, with the command that installs it.
    """
    with open_storage(place) as storage:
        storage.fetch()
        if storage.remote and not any(storage.path.iterdir()):
            raise InputError(f"{storage} holds no run; give the place that one was written to")
        yield storage.path


def is_remote(place: Place | Storage) -> bool:
    """Whether a place is in an object store."""
    return str(place).partition("://")[0] in SCHEMES


def resolve_place(place: Place) -> str | Path:
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
    raise InputError(f"{text} is no place for a run; give a folder, file:///FOLDER, or {kinds}")


def parquet_files(url: str, folder: str) -> tuple[Any, list[str]]:
    """A file system of fsspec, and the names on it of a place's Parquet files in a folder, sorted.

    Raises:
        ValueError: for a URL that names no place.
        StorageError: if the store does not answer.
        ModuleNotFoundError: without the extra, with the command that installs it.
    """
    place = url.partition("://")[2].rstrip("/")
    with wrap_store_errors(url):
        listed = load("obstore", "storage").list(_open_store(url), folder).collect()
    names = sorted(str(one["path"]) for one in listed)
    return _file_system(url), [f"{place}/{n}" for n in names if n.endswith(".parquet")]


@contextmanager
def wrap_store_errors(url: str) -> Iterator[None]:
    """Turn what obstore raises into one sentence, but for what is there or is not."""
    faults = load("obstore.exceptions", "storage")
    try:
        yield
    except (faults.AlreadyExistsError, FileNotFoundError):
        raise
    except faults.BaseError as error:
        raise StorageError(
            f"{url} does not answer as a store that one may read and write: {_shorten(error)}; see "
            "that the bucket is there, and that the environment has credentials for it "
            "(AWS_ACCESS_KEY_ID, AWS_ENDPOINT_URL, …)"
        ) from None


def holder_text() -> str:
    """What a lock file says of this process."""
    since = time.strftime("%Y-%m-%d %H:%M:%S UTC", time.gmtime())
    return json.dumps({"host": socket.gethostname(), "process": os.getpid(), "since": since})


def _read_holder(text: str) -> Mapping[str, Any]:
    with suppress(ValueError):
        held = json.loads(text)
        if isinstance(held, dict):
            return held
    return {}


def _format_holder(text: str) -> str:
    """Who holds a lock, for people."""
    holder = _read_holder(text)
    if not {"host", "process", "since"} <= holder.keys():
        return "another process"
    return f"process {holder['process']} on {holder['host']} (since {holder['since']})"


def _is_alive(process: Any) -> bool:
    try:
        os.kill(int(process), 0)
    except (ProcessLookupError, TypeError, ValueError):
        return False
    except OSError:  # somebody else's
        return True
    return True


def _open_store(url: str) -> Any:
    stores, faults = load("obstore.store", "storage"), load("obstore.exceptions", "storage")
    try:
        return stores.from_url(url, **_client_options())
    except (faults.BaseError, ValueError) as error:
        raise InputError(f"{url} names no place in an object store: {_shorten(error)}") from None


def _file_system(url: str) -> Any:
    scheme = url.partition("://")[0]
    return load("obstore.fsspec", "storage").FsspecStore(scheme, **_client_options())


def _client_options() -> dict[str, Any]:
    """What the environment does not tell the client: a plain endpoint that is named is meant."""
    plain = any(os.environ.get(name, "").startswith("http://") for name in ENDPOINTS)
    return {"client_options": {"allow_http": True}} if plain else {}


def _shorten(error: Exception) -> str:
    text = " ".join(str(error).split())
    return text if len(text) <= _MOST_TEXT else f"{text[:_MOST_TEXT]}…"


def _stamp(path: Path) -> tuple[int, int]:
    """What tells a file from what it was: time of its change, ns, and size, bytes."""
    status = path.stat()
    return status.st_mtime_ns, status.st_size


def _is_hidden(name: str) -> bool:
    """Whether a file is a lock or somebody's temporary one; folders of a run may be hidden."""
    folder, _, rest = name.partition("/")
    return any(part.startswith(".") for part in (rest or folder).split("/"))


def _is_last(name: str) -> int:
    """Place in the order in which files are sent: what rests on others comes after them."""
    part = name.partition("/")[0]
    return _LAST.index(part) + 1 if part in _LAST else 0
