"""Rows of the episodes that are under way in the lanes of a vector environment."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[Any]


class LaneBuffer:
    """The last control steps of all lanes, at least one horizon of them.

    Args:
        entries: of a row.
        lanes: number of lanes.
        horizon: most control steps of an episode.

    Attributes:
        active: lanes with an episode under way that is recorded, shape (lanes,).
    """

    def __init__(self, entries: int, lanes: int, horizon: int) -> None:
        self.active = np.zeros(lanes, dtype=bool)
        self._first = np.zeros((entries, lanes))
        self._steps = np.zeros((entries, horizon + 64 + horizon // 2, lanes))
        self._starts = np.zeros(lanes, dtype=np.int64)
        self._time = 0

    def add(self, row: Sequence[Array]) -> None:
        """Take in a control step: every entry of its row, of shape (lanes,).

        Steps that no episode under way needs are dropped when there is no room.
        """
        if self._time == self._steps.shape[1]:
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
        if not self.active.any():
            self._time = 0
        self._first[:, lanes] = first
        self._starts[lanes] = self._time
        self.active[lanes] = record

    def end(self, lanes: Array) -> tuple[Array, Array]:
        """End the episodes in ``lanes`` with the last row.

        Returns:
            Their rows one after the other, lane by lane, shape (entries, sum of counts), and how
            many each has, its reset's included.
        """
        self.active[lanes] = False
        counts = self._time - self._starts[lanes] + 1
        if len(lanes) > 1 and lanes[-1] - lanes[0] + 1 == len(lanes) and not np.ptp(counts):
            return self._beside_each_other(lanes, int(counts[0])), counts
        places, resets = self._places(lanes, counts)
        rows = self._steps.reshape(len(self._steps), -1).take(places, axis=1)
        rows[:, resets] = self._first[:, lanes]
        return rows, counts

    def _places(self, lanes: Array, counts: Array) -> tuple[Array, Array]:
        """Where the rows of some lanes are among all steps of all lanes, and which are resets'.

        A reset's place is any.
        """
        ends = np.cumsum(counts)
        last = (self._time - 1) * self._steps.shape[2] + lanes
        to_go = np.repeat(ends, counts) - np.arange(1, ends[-1] + 1)
        places = np.repeat(last, counts) - to_go * self._steps.shape[2]
        resets = ends - counts
        places[resets] = 0
        return places, resets

    def _beside_each_other(self, lanes: Array, count: int) -> Array:
        """Rows of neighbouring lanes whose episodes began together."""
        neighbours = slice(int(lanes[0]), int(lanes[-1]) + 1)
        rows = np.empty((len(self._first), len(lanes), count))
        rows[:, :, 0] = self._first[:, neighbours]
        steps = self._steps[:, self._time - count + 1 : self._time, neighbours]
        rows[:, :, 1:] = steps.transpose(0, 2, 1)
        return rows.reshape(len(rows), -1)
