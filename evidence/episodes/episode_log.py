"""Finished episodes on their way to the store."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from .context import EpisodeContext
from .layout import Layout
from .summary import summarise

Array = npt.NDArray[Any]


class EpisodeHead(NamedTuple):
    """What identifies an episode.

    Attributes:
        index: number of the episode in its cell.
        seed: seed given, or None.
        rng_key: see the record field of that name.
        wall_start: Unix time of its start, µs.
        wall_end: Unix time of its end, µs.
        setup: which of the environment's setups it ran on.
        context: which of the recorder's contexts it belongs to.
    """

    index: int
    seed: int | None
    rng_key: str
    wall_start: int
    wall_end: int
    setup: int = 0
    context: int = 0


@dataclass(frozen=True)
class Episodes:
    """Finished episodes as columns.

    Attributes:
        heads: one per episode.
        summary: see :func:`integ_gym.evidence.episodes.summary.summarise`.
        traced: whether an episode has a trace, shape (episodes,).
        rows: rows of those that have, shape (entries, sum of counts).
        counts: rows of each of those, shape (episodes with a trace,).
    """

    heads: tuple[EpisodeHead, ...]
    summary: dict[str, Array]
    traced: Array
    rows: Array
    counts: Array


class EpisodeLog:
    """Summarises finished episodes as they come and keeps the traces that are wanted.

    Args:
        layout: what the entries of a row are.
        contexts: what the episodes are for; each belongs to one of them.
        rows_at_once: episodes wait for so many rows until they are summarised together.
    """

    def __init__(
        self, layout: Layout, contexts: Sequence[EpisodeContext], rows_at_once: int = 1 << 16
    ) -> None:
        self.layout = layout
        self._rows_at_once = rows_at_once
        self.contexts = tuple(contexts)
        self._parts: list[Episodes] = []
        self._heads: list[EpisodeHead] = []
        self._pending: list[tuple[Array, Array]] = []
        self._pending_rows = 0

    def __len__(self) -> int:
        return sum(len(part.heads) for part in self._parts) + len(self._heads)

    def add(self, rows: Array, counts: Array, heads: Sequence[EpisodeHead]) -> None:
        """Take in whole episodes.

        Args:
            rows: their rows one after the other, shape (entries, sum of counts); not to be changed
                afterwards.
            counts: rows of each, its reset included, shape (episodes,).
            heads: one per episode.
        """
        self._heads += heads
        self._pending.append((rows, counts))
        self._pending_rows += rows.shape[1]
        if self._pending_rows >= self._rows_at_once:
            self._summarise()

    def episodes(self) -> Episodes:
        """All episodes so far, in the order in which they came."""
        self._summarise()
        if len(self._parts) > 1:
            self._parts = [_joined(self._parts)]
        return self._parts[0] if self._parts else _nothing(self.layout)

    def clear(self) -> None:
        """Forget them."""
        self._parts = []
        self._heads, self._pending, self._pending_rows = [], [], 0

    def _summarise(self) -> None:
        """Summarise what is pending and drop the traces that are not wanted."""
        if not self._heads:
            return
        rows = _beside([rows for rows, _ in self._pending])
        counts = np.concatenate([counts for _, counts in self._pending])
        traced = np.array([self.contexts[h.context].has_trace(h.index) for h in self._heads])
        kept = rows if traced.all() else rows[:, np.repeat(traced, counts)]
        summary = summarise(self.layout, rows, counts)
        self._parts.append(Episodes(tuple(self._heads), summary, traced, kept, counts[traced]))
        self._heads, self._pending, self._pending_rows = [], [], 0


def _joined(parts: list[Episodes]) -> Episodes:
    return Episodes(
        tuple(head for part in parts for head in part.heads),
        {name: np.concatenate([p.summary[name] for p in parts]) for name in parts[0].summary},
        np.concatenate([part.traced for part in parts]),
        _beside([part.rows for part in parts]),
        np.concatenate([part.counts for part in parts]),
    )


def _beside(rows: list[Array]) -> Array:
    return rows[0] if len(rows) == 1 else np.concatenate(rows, axis=1)


def _nothing(layout: Layout) -> Episodes:
    rows, counts = np.zeros((len(layout), 2)), np.array([2])
    summary = {name: x[:0] for name, x in summarise(layout, rows, counts).items()}
    return Episodes((), summary, np.zeros(0, dtype=bool), rows[:, :0], counts[:0])
