"""A prefix of an object store as the place of a run, with a copy on this machine to work on."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from types import TracebackType
from typing import Any, NamedTuple

from ..packages.extras import load
from ..sharing.claims import LEASE
from .objects import ObjectFiles, asking, opened_store
from .probing import check_store
from .sessions import SESSIONS, Sessions, over
from .storage import Busy

AT_ONCE = 16
"""Requests that are under way at the same time."""


class _Held(NamedTuple):
    """What the copy has of an object: how the store tells it from another, and the file's time."""

    stamp: Mapping[str, Any]
    changed: int


class BucketStorage:
    """A prefix of a store; see `Storage`. The copy is a temporary folder and goes with this.

    Args:
        url: ``s3://BUCKET/PREFIX``, ``gs://…`` or ``az://…``.

    Raises:
        ValueError: for another URL.
        ModuleNotFoundError: without the extra, with the command that installs it.
    """

    remote = True

    def __init__(self, url: str) -> None:
        self.url = url
        self._obstore = load("obstore", "storage")
        self._faults = load("obstore.exceptions", "storage")
        self._store = opened_store(url)
        self._folder = TemporaryDirectory(prefix="integ-gym-run-", ignore_cleanup_errors=True)
        self.path = Path(self._folder.name)
        self._held: dict[str, _Held] = {}

    def __str__(self) -> str:
        return self.url

    def __enter__(self) -> BucketStorage:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._folder.cleanup()

    def check(self) -> None:
        """See `Storage`."""
        check_store(self._store, self.url)

    @contextmanager
    def held(self, alone: bool, lease: float = LEASE) -> Iterator[str]:
        """See `Storage`; by objects that are touched for as long as the block lasts."""
        files = ObjectFiles(self._store, self.url, SESSIONS)
        with Sessions(files, self.url, lease).joined(alone) as number:
            yield str(number)

    def shared(self, folder: str, within: str = "") -> ObjectFiles:
        """See `Storage`."""
        ended = f"{SESSIONS}/{over(within.rpartition('/')[2])}" if within else None
        return ObjectFiles(self._store, self.url, folder, ended)

    def folders(self, folder: str) -> list[str]:
        """See `Storage`."""
        with asking(self.url):
            found = self._obstore.list_with_delimiter(self._store, folder or None)
            found = found["common_prefixes"]
        return sorted(str(name).rpartition("/")[2] for name in found)

    def files(self, folder: str) -> list[str]:
        """See `Storage`."""
        return sorted(name for name in self._listed(folder) if not _is_hidden(name, folder))

    def move(self, names: Mapping[str, str]) -> None:
        """See `Storage`; by copies within the store."""

        def copy(name: str) -> None:
            with asking(self.url), suppress(FileNotFoundError):  # somebody else was faster
                self._obstore.copy(self._store, name, names[name])

        self._all(copy, [*names])

    def remove(self, folder: str) -> None:
        """See `Storage`."""
        self._delete(self._listed(folder))
        shutil.rmtree(self.path / folder, ignore_errors=True)

    def end(self, folder: str, fences: Callable[[str], bool]) -> None:
        """See `Storage`; a few bytes for each unit stay for good, for nothing else can refuse."""
        ObjectFiles(self._store, self.url, SESSIONS).create(over(folder.rpartition("/")[2]), "")
        start = len(folder) + 1
        self._delete(name for name in self._listed(folder) if not fences(name[start:]))

    def vanish(self, folder: str) -> None:
        """None: a store has no step that takes a folder away."""
        return

    def vanished(self, folder: str) -> list[str]:
        """None."""
        return []

    def fetch(self, *names: str) -> None:
        """See `Storage`."""
        there: dict[str, Any] = {}
        folders = [name.rstrip("/") for name in names if name.endswith("/")]
        if not names:
            with asking(self.url):
                top = self._obstore.list_with_delimiter(self._store)
            there |= {str(one["path"]): one for one in top["objects"]}
            folders = [str(name) for name in top["common_prefixes"]]
        for folder in folders:
            if not folder.startswith("."):
                there |= self._listed(folder)
        single = [name for name in names if not name.endswith("/")]
        there = {name: one for name, one in there.items() if not _is_hidden(name)}
        for name in [*self._held]:
            within = not names or any(name.startswith(f"{folder}/") for folder in folders)
            if within and name not in there:
                self._lose(name)
        new = [n for n, one in there.items() if self._stamp(n) != _stamp(one)]
        self._all(self._get, [*new, *single])

    def keep(self, *folders: str) -> None:
        """See `Storage`."""
        for folder in folders:
            found = (file for file in (self.path / folder).rglob("*") if file.is_file())
            names = [file.relative_to(self.path).as_posix() for file in found]
            self._all(self._make, [n for n in names if n not in self._held and _is_sent(n)])

    def publish(self, name: str) -> None:
        """See `Storage`."""
        held = self._held.get(name)
        if held is not None and held.changed == _changed(self.path / name):
            return
        mode: Any = "create" if held is None else dict(held.stamp)
        with asking(self.url):
            try:
                self._put(name, mode)
            except (self._faults.AlreadyExistsError, self._faults.PreconditionError):
                raise Busy(f"{self.url}/{name}") from None
            except FileNotFoundError:
                raise Busy(f"{self.url}/{name}") from None

    def changed(self) -> list[str]:
        """See `Storage`."""
        found = sorted(file for file in self.path.rglob("*") if file.is_file())
        names = {file.relative_to(self.path).as_posix(): file for file in found}
        return [
            name
            for name, file in names.items()
            if not _is_hidden(name)
            and (name not in self._held or self._held[name].changed != _changed(file))
        ]

    def drop_missing(self) -> None:
        """See `Storage`."""
        for name in [*self._held]:
            if not (self.path / name).exists():
                if self._stamp(name) == _stamp(self._head(name)):
                    self._delete([name])
                del self._held[name]

    def _stamp(self, name: str) -> Mapping[str, Any] | None:
        held = self._held.get(name)
        return None if held is None else held.stamp

    def _head(self, name: str) -> Any | None:
        with asking(self.url):
            try:
                return self._obstore.head(self._store, name)
            except FileNotFoundError:
                return None

    def _listed(self, folder: str) -> dict[str, Any]:
        """All objects in and below a folder, by name."""
        with asking(self.url):
            found = self._obstore.list(self._store, folder).collect()
        return {str(one["path"]): one for one in found}

    def _get(self, name: str) -> None:
        """Have the copy's file be that of the store."""
        stamp = self._stamp(name) if (self.path / name).exists() else None
        known = {"if_none_match": stamp["e_tag"]} if stamp and stamp.get("e_tag") else {}
        with asking(self.url):
            try:
                got = self._obstore.get(self._store, name, options=known)
                content = bytes(got.bytes())
            except FileNotFoundError:
                self._lose(name)
                return
            except self._faults.NotModifiedError:
                return
        target = self.path / name
        target.parent.mkdir(parents=True, exist_ok=True)
        made = target.with_name(f".{target.name}.part")
        made.write_bytes(content)
        os.replace(made, target)
        self._held[name] = _Held(_stamp(got.meta), _changed(target))

    def _lose(self, name: str) -> None:
        """Have the copy's file be gone, as it is from the store."""
        if self._held.pop(name, None) is not None:
            (self.path / name).unlink(missing_ok=True)

    def _make(self, name: str) -> None:
        with asking(self.url), suppress(self._faults.AlreadyExistsError):
            self._put(name, "create")

    def _put(self, name: str, mode: Any) -> None:
        file = self.path / name
        made = self._obstore.put(
            self._store, name, file.read_bytes(), mode=mode, use_multipart=False
        )
        if not _is_hidden(name):
            self._held[name] = _Held(_stamp(made), _changed(file))

    def _delete(self, names: Iterable[str]) -> None:
        found = [*names]
        if found:
            with asking(self.url), suppress(FileNotFoundError):
                self._obstore.delete(self._store, found)

    def _all(self, do: Callable[[str], None], names: list[str]) -> None:
        with ThreadPoolExecutor(AT_ONCE) as pool:
            for _ in pool.map(do, names):
                pass


def _stamp(told: Any | None) -> dict[str, Any]:
    """How a store tells an object from another of its name."""
    held = told or {}
    return {key: held[key] for key in ("e_tag", "version") if held.get(key) is not None}


def _changed(file: Path) -> int:
    return file.stat().st_mtime_ns


def _is_hidden(name: str, below: str = "") -> bool:
    inner = name[len(below) :].lstrip("/") if below else name
    return any(part.startswith(".") for part in inner.split("/"))


def _is_sent(name: str) -> bool:
    return not name.rpartition("/")[2].startswith(".")
