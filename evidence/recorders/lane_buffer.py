"""Rows of the episodes that are under way in the lanes of a vector environment."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
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

    def end(self, lanes: Array) -> Iterator[tuple[Array, Array]]:
        """End the episodes in ``lanes`` with the last row.

        Yields:
            Lanes whose episodes began together, and their rows, shape (entries, lanes, rows).
        """
        self.active[lanes] = False
        lanes = lanes[np.argsort(self._starts[lanes], kind="stable")]
        for together in np.split(lanes, np.flatnonzero(np.diff(self._starts[lanes])) + 1):
            start = self._starts[together[0]]
            rows = np.empty((len(self._first), len(together), self._time - start + 1))
            rows[:, :, 0] = self._first[:, together]
            rows[:, :, 1:] = self._taken(start, together).transpose(0, 2, 1)
            yield together, rows

    def _taken(self, start: int, lanes: Array) -> Array:
        """Steps of some lanes, shape (entries, steps, lanes); a view where they are neighbours."""
        steps = self._steps[:, start : self._time]
        first, last = int(lanes[0]), int(lanes[-1])
        if last - first + 1 == len(lanes):
            return steps[:, :, first : last + 1]
        return steps.take(lanes, axis=2)
