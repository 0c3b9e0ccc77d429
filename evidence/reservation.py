"""Which episodes a recorder is going to record, so that no other records the same ones."""

from __future__ import annotations

import hashlib
import json
import os
import re
import sys
import uuid
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TypeAlias

from integ_gym.support.files import make_folder
from integ_gym.support.storage import FileLock

from .labels import EpisodeContext
from .schema import EvidenceError
from .store import EvidenceStore

Episodes: TypeAlias = Sequence[int]
"""Indices, listed or as a range; see also :func:`from_on`."""

_REMEDY = (
    "every recorder needs a context of its own: give each environment of a vector its own `cell`, "
    "or record the vector environment as one with RecordVectorEvidence"
)

_ENDING = ".recording"


class Reservation:
    """Episodes of some contexts, held in a store's directory until they are released.

    A file for each context says what is going to be recorded of it; it is there, and read by
    others, as long as the lock beside it is held. A process that has ended, however it did, holds
    nothing.

    Args:
        store: of the records; its directory is made if it is not there.
        contexts: what the episodes are for.
        episodes: of each context.

    Raises:
        EvidenceError: see :meth:`hold`.
        ValueError: if the directory cannot be written to.
    """

    def __init__(
        self,
        store: EvidenceStore,
        contexts: Sequence[EpisodeContext],
        episodes: Sequence[Episodes],
    ) -> None:
        make_folder(store.directory)
        self._store = store
        self._claims: list[tuple[EpisodeContext, Path, FileLock]] = []
        for context in contexts:
            path = store.directory / f".{_identity(context)}-{uuid.uuid4().hex}{_ENDING}"
            lock = _lock_of(path)
            lock.acquire()
            self._claims.append((context, path, lock))
            path.touch()
        try:
            self.hold(episodes)
        except BaseException:
            self.release()
            raise

    def hold(self, episodes: Sequence[Episodes]) -> None:
        """Hold further episodes of each context, all or none.

        Of two that claim the same at one moment, at least one sees the other: each says what it
        wants before it looks.

        Raises:
            EvidenceError: if another recorder is open for one of them, or one has been recorded.
        """
        before = [path.stat().st_size for _, path, _ in self._claims]
        try:
            for (context, path, _), wanted in zip(self._claims, episodes, strict=True):
                claim = wanted.start if isinstance(wanted, range) else list(wanted)
                with path.open("a", encoding="utf-8") as file:
                    file.write(f"{json.dumps(claim)}\n")
                _check_free(path, context, wanted)
                _check_unrecorded(self._store, context, wanted)
        except BaseException:
            for (_, path, _), size in zip(self._claims, before, strict=True):
                os.truncate(path, size)
            raise

    def release(self) -> None:
        """Let others record them."""
        for _, path, lock in self._claims:
            path.unlink(missing_ok=True)
            lock.release()


def from_on(first: int) -> range:
    """All episodes from ``first`` on, because the end of a count is unknown."""
    return range(first, sys.maxsize)


def batch_name(
    env_id: str, contexts: Sequence[EpisodeContext], episodes: Sequence[tuple[int, int]]
) -> str:
    """Name of a batch, the same for the same work.

    Args:
        env_id: of the environment.
        contexts: of the recorder.
        episodes: number of the context, and index of each.
    """
    indices = [index for _, index in episodes]
    stem = re.sub(r"[^A-Za-z0-9.]+", "-", env_id).strip(".-")[:80] or "records"
    shared = f"{len(contexts)}x" if len(contexts) > 1 else ""
    name = f"{stem}-{shared}{_identity(*contexts)}-{min(indices):07d}-{max(indices):07d}"
    if len(contexts) == 1 and len(indices) == max(indices) - min(indices) + 1:
        return name
    return f"{name}-{hashlib.sha256(repr(sorted(episodes)).encode()).hexdigest()[:8]}"


_OF_ONE_CONTEXT = re.compile(r".+-([0-9a-f]{16})-(\d{7,})-(\d{7,})(-[0-9a-f]{8})?\.parquet")
"""A file that :func:`batch_name` named; the last part where episodes are missing in between."""


def _identity(*contexts: EpisodeContext) -> str:
    """Hash of the cells and policies whose episodes are counted together."""
    identity = repr([(c.cell, c.policy_id, c.policy_hash) for c in contexts])
    return hashlib.sha256(identity.encode()).hexdigest()[:16]


def _lock_of(path: Path) -> FileLock:
    """The lock beside a claim's file."""
    return FileLock(path.with_name(f"{path.name}.lock"))


def _check_free(own: Path, context: EpisodeContext, wanted: Episodes) -> None:
    """Refuse what another recorder is open for; what is no longer held is removed."""
    for path in own.parent.glob(f".{_identity(context)}-*{_ENDING}"):
        lock = _lock_of(path)
        if path == own:
            continue
        if lock.acquire():
            path.unlink(missing_ok=True)
            lock.release()
            continue
        try:
            lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
        except FileNotFoundError:  # it has been released
            continue
        for claim in [json.loads(line) for line in lines if line.endswith("\n")]:
            other = from_on(claim) if isinstance(claim, int) else claim
            common = _least_common(wanted, other)
            if common is not None:
                counted = isinstance(other, range)
                held = f"from episode {other[0]} on" if counted else f"episode {common}"
                raise EvidenceError(
                    f"another recorder is open in {own.parent} for cell {context.cell!r}, policy "
                    f"{context.policy_id!r}, {held}; {_REMEDY}; if it is an earlier one, close() "
                    "it first"
                )


def _check_unrecorded(store: EvidenceStore, context: EpisodeContext, wanted: Episodes) -> None:
    """Refuse what the store holds."""
    recorded = list(_find_recorded(store, context))
    last = max((max(indices) for _, indices in recorded), default=0)
    for file, indices in recorded:
        if _least_common(wanted, indices) is not None:
            counted = isinstance(wanted, range)
            others = f"count on with first_episode={last + 1}" if counted else "give other episodes"
            raise EvidenceError(
                f"{file} holds episodes {min(indices)} to {max(indices)} of cell "
                f"{context.cell!r} and policy {context.policy_id!r} already; {others}, give "
                "another cell or directory, or move away what is to be recorded anew"
            )


def _find_recorded(
    store: EvidenceStore, context: EpisodeContext
) -> Iterator[tuple[Path, Episodes]]:
    """Files of a store that hold a context's episodes, with their indices.

    A name that a recorder gave tells enough, but for several contexts or with episodes missing.
    """
    for file in store.files():
        match = _OF_ONE_CONTEXT.fullmatch(file.name)
        if match and match[1] != _identity(context):
            continue
        indices: Episodes
        if match and not match[4]:
            indices = range(int(match[2]), int(match[3]) + 1)
        else:
            own = {name: getattr(context, name) for name in ("cell", "policy_id", "policy_hash")}
            indices = store.episode_indices(file.name, **own)
        if indices:
            yield file, indices


def _least_common(one: Episodes, other: Episodes) -> int | None:
    """The least episode that is in both; None if there is none."""
    if isinstance(one, range) and isinstance(other, range):
        first = max(one.start, other.start)
        return first if first < min(one.stop, other.stop) else None
    listed, others = (other, one) if isinstance(one, range) else (one, other)
    among = others if isinstance(others, range) else set(others)
    return min((index for index in listed if index in among), default=None)
