"""Which episodes a recorder is going to record, so that no other records the same ones."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Sequence
from pathlib import Path

from integ_gym.support import FileLock, make_folder

from ..episodes import EpisodeContext
from ..schema import EvidenceError

_REMEDY = (
    "every recorder needs a context of its own: give each environment of a vector its own `cell`, "
    "or record the vector environment as one with RecordVectorEvidence"
)


class Reservation:
    """Episodes of some contexts, held in a store's directory until they are released.

    Args:
        directory: of the store; made if it is not there.
        contexts: what the episodes are for.
        firsts: index of the first episode of each.

    Raises:
        EvidenceError: if another recorder is open for them, or they have been recorded.
        ValueError: if the directory cannot be written to.
    """

    def __init__(
        self, directory: Path, contexts: Sequence[EpisodeContext], firsts: Sequence[int]
    ) -> None:
        make_folder(directory)
        self._locks: list[FileLock] = []
        try:
            for context, first in zip(contexts, firsts, strict=True):
                self._hold(directory, context, first)
            _check_unrecorded(directory, contexts, min(firsts))
        except EvidenceError:
            self.release()
            raise

    def release(self) -> None:
        """Let others record them."""
        for lock in self._locks:
            lock.release()
        self._locks = []

    def _hold(self, directory: Path, context: EpisodeContext, first: int) -> None:
        lock = FileLock(directory / f".{identity_of([context])}-{first}.recording")
        if not lock.acquire():
            raise EvidenceError(
                f"another recorder is open in {directory} for cell {context.cell!r}, policy "
                f"{context.policy_id!r}, from episode {first} on; {_REMEDY}; if it is an earlier "
                "one, close() it first"
            )
        self._locks.append(lock)


def identity_of(contexts: Sequence[EpisodeContext]) -> str:
    """Hash of the cells and policies whose episodes are counted together."""
    identity = repr([(c.cell, c.policy_id, c.policy_hash) for c in contexts])
    return hashlib.sha256(identity.encode()).hexdigest()[:16]


def batch_name(env_id: str, identity: str, episodes: Sequence[tuple[int, int]]) -> str:
    """Name of a batch, the same for the same work.

    Args:
        env_id: of the environment.
        identity: see :func:`identity_of`.
        episodes: context and index of each.
    """
    contexts, indices = zip(*episodes, strict=True)
    stem = re.sub(r"[^A-Za-z0-9.]+", "-", env_id).strip(".-")[:80] or "records"
    name = f"{stem}-{identity}-{min(indices):07d}-{max(indices):07d}"
    if len(set(contexts)) == 1 and len(indices) == max(indices) - min(indices) + 1:
        return name
    return f"{name}-{hashlib.sha256(repr(sorted(episodes)).encode()).hexdigest()[:8]}"


def _check_unrecorded(directory: Path, contexts: Sequence[EpisodeContext], first: int) -> None:
    """Refuse to record what a batch of :func:`batch_name` holds.

    Raises:
        EvidenceError: with what to do.
    """
    name = re.compile(rf".+-{identity_of(contexts)}-(\d+)-(\d+)(-[0-9a-f]{{8}})?\.parquet")
    for file in directory.iterdir():
        held = name.fullmatch(file.name)
        if held and int(held[1]) <= first <= int(held[2]):
            raise EvidenceError(
                f"{file} holds episodes {int(held[1])} to {int(held[2])} of cell "
                f"{contexts[0].cell!r} and policy {contexts[0].policy_id!r} already; count on with "
                f"first_episode={int(held[2]) + 1}, give another cell or directory, or move the "
                "file away to record them anew"
            )
