"""Rows of the episodes that are under way in the lanes of a vector environment."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ..episodes.episode_log import EpisodeHeads

Array = npt.NDArray[Any]

_WIDE, _GAP = 64, 8
"""Lanes in whole multiples of the first are set apart by a gap, for a processor's cache keeps few
numbers that lie a power of two apart, as those of a lane would."""


class _Ended(NamedTuple):
    """Episodes that have ended and wait to be gathered."""

    lanes: Array
    """Where they were, shape (episodes,)."""
    ends: Array
    """Steps in the buffer when each ended, its last one included, shape (episodes,)."""
    counts: Array
    """Rows of each, its reset's included, shape (episodes,)."""
    first: Array
    """Their rows at the reset, shape (entries, episodes)."""


class LaneBuffer:
    """The last control steps of all lanes, at least one horizon of them.

    Args:
        entries: of a row.
        lanes: number of lanes.
        horizon: most control steps of an episode.

    Attributes:
        active: lanes with an episode under way that is recorded, shape (lanes,).
        episodes: that have ended and wait to be gathered.
        waiting: rows of these.
    """

    def __init__(self, entries: int, lanes: int, horizon: int) -> None:
        self.active = np.zeros(lanes, dtype=bool)
        self.episodes = self.waiting = 0
        self._ended: list[tuple[_Ended, EpisodeHeads]] = []
        self._first = np.zeros((entries, lanes))
        self._stride = lanes + (0 if lanes % _WIDE else _GAP)
        self._rows = np.zeros((entries, horizon + 64 + horizon // 2, self._stride))
        self._steps = self._rows[:, :, :lanes]
        self._starts = np.zeros(lanes, dtype=np.int64)
        self._time = 0

    @property
    def full(self) -> bool:
        """Whether there is no room for a step; gathering what waits makes some."""
        return self._time >= len(self._steps[0])

    def add(self, row: Sequence[Array]) -> None:
        """Take in a control step: every entry of its row, of shape (lanes,).

        Steps that no episode under way needs are dropped when there is no room.

        Raises:
            BufferError: if episodes wait while there is no room.
        """
        if self.full:
            if self.waiting:
                raise BufferError("episodes wait in a full buffer; gather them first")
            oldest = int(self._starts[self.active].min(initial=self._time))
            self._steps[:, : self._time - oldest] = self._steps[:, oldest : self._time]
            self._starts -= oldest
            self._time -= oldest
        for place, values in enumerate(row):
            self._steps[place, self._time] = values
        self._time += 1

    def begin(self, lanes: Array, first: Array, record: Array) -> None:
        """Begin an episode in some lanes, after the last row.

        Args:
            lanes: lane numbers.
            first: their rows at the reset, shape (entries, len(lanes)).
            record: whether each of these episodes is recorded.
        """
        if not (self.waiting or self.active.any()):
            self._time = 0
        self._first[:, lanes] = first
        self._starts[lanes] = self._time
        self.active[lanes] = record

    def end(self, lanes: Array, heads: EpisodeHeads) -> None:
        """End episodes with the last row; they wait to be gathered.

        Args:
            lanes: lane numbers, ascending.
            heads: what identifies the episodes.
        """
        self.active[lanes] = False
        counts = self._time - self._starts[lanes] + 1
        ends = np.full(len(lanes), self._time)
        self._ended.append((_Ended(lanes, ends, counts, self._first[:, lanes]), heads))
        self.episodes += len(lanes)
        self.waiting += int(counts.sum())

    def gathered(self) -> tuple[Array, Array, EpisodeHeads]:
        """The episodes that wait, at least one, in the order in which they ended.

        They wait until :meth:`forget`, so that nothing is lost where gathering is interrupted.

        Returns:
            Their rows one after the other, shape (entries, sum of counts), how many each has, its
            reset's included, and what identifies them.
        """
        columns = zip(*(ended for ended, _ in self._ended), strict=True)
        ended = _Ended(*(np.concatenate(parts, axis=-1) for parts in columns))
        heads = EpisodeHeads.joined([heads for _, heads in self._ended])
        return self._rows_of(ended), ended.counts, heads

    def forget(self) -> None:
        """Drop the episodes that wait."""
        self._ended, self.episodes, self.waiting = [], 0, 0

    def _rows_of(self, ended: _Ended) -> Array:
        lanes, ends, counts, first = ended
        together = not (np.ptp(ends) or np.ptp(counts))
        if together and len(lanes) > 1 and (np.diff(lanes) == 1).all():
            return self._beside_each_other(ended)
        places, resets = self._places(ended)
        rows = np.empty((len(self._rows), len(places)))
        for entry, steps in enumerate(self._rows.reshape(len(self._rows), -1)):
            steps.take(places, out=rows[entry], mode="clip")  # unbuffered; all places are in range
        rows[:, resets] = first
        return rows

    def _places(self, ended: _Ended) -> tuple[Array, Array]:
        """Where the rows of episodes are among all steps of all lanes, and which are resets'.

        A reset's place is any.
        """
        stops = np.cumsum(ended.counts)
        last = (ended.ends - 1) * self._stride + ended.lanes
        to_go = np.repeat(stops, ended.counts) - np.arange(1, stops[-1] + 1)
        places = np.repeat(last, ended.counts) - to_go * self._stride
        resets = stops - ended.counts
        places[resets] = 0
        return places, resets

    def _beside_each_other(self, ended: _Ended) -> Array:
        """Rows of neighbouring lanes whose episodes began and ended together."""
        neighbours = slice(int(ended.lanes[0]), int(ended.lanes[-1]) + 1)
        end, count = int(ended.ends[0]), int(ended.counts[0])
        rows = np.empty((len(self._rows), len(ended.lanes), count))
        rows[:, :, 0] = ended.first
        steps = self._steps[:, end - count + 1 : end, neighbours]
        rows[:, :, 1:] = steps.transpose(0, 2, 1)
        return rows.reshape(len(rows), -1)
