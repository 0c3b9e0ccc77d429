"""Rows of the episodes that are under way in the lanes of a vector environment."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from integ_gym.evidence.fields import STATUS_CODES
from integ_gym.evidence.layout import STATUS, Layout

Array = npt.NDArray[Any]

_ENDING = ("reward", "terminated", "truncated")


class LaneBuffer:
    """The last control steps of all lanes, at least one horizon of them.

    Args:
        layout: what the entries of a row are.
        lanes: number of lanes.
        horizon: most control steps of an episode.

    Attributes:
        active: lanes with an episode under way that is recorded, shape (lanes,).
    """

    def __init__(self, layout: Layout, lanes: int, horizon: int) -> None:
        self.layout = layout
        self.active = np.zeros(lanes, dtype=bool)
        self._first = np.zeros((len(layout), lanes))
        self._steps = np.zeros((len(layout), horizon + 64 + horizon // 2, lanes))
        self._starts = np.zeros(lanes, dtype=np.int64)
        self._time = 0

    def next_row(self) -> Array:
        """The row of the next control step, shape (entries, lanes), to be written to.

        Steps that no episode under way needs are dropped when there is no room.
        """
        if self._time == self._steps.shape[1]:
            oldest = int(self._starts[self.active].min(initial=self._time))
            self._steps[:, : self._time - oldest] = self._steps[:, oldest : self._time]
            self._starts -= oldest
            self._time -= oldest
        self._time += 1
        row: Array = self._steps[:, self._time - 1]
        return row

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
        for name in _ENDING:
            self._first[self.layout.place(name), lanes] = 0.0
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
            rows = np.empty((len(self.layout), len(together), self._time - start + 1))
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


def fill(
    layout: Layout, row: Array, lanes: Any, info: Mapping[str, Any], observed: Array, state: Array
) -> None:
    """Write what a step or reset gave into some lanes of a row.

    Args:
        layout: what the entries of the row are.
        row: shape (entries, all lanes).
        lanes: lane numbers, or a slice.
        info: arrays of shape (all lanes,).
        observed: observations of these lanes, shape (lanes, observations).
        state: their true states, shape (lanes, states).
    """
    for place, name in enumerate(layout.info):
        row[place, lanes] = info[name][lanes]
    row[layout.place(STATUS), lanes] = _codes(info["solver_status"][lanes])
    row[layout.places(layout.sensed), lanes] = observed.T
    row[layout.places(layout.state), lanes] = state.T


def fill_ending(layout: Layout, row: Array, ending: tuple[Array, Array, Array]) -> None:
    """Write reward, terminated and truncated of all lanes into a row."""
    for name, values in zip(_ENDING, ending, strict=True):
        row[layout.place(name)] = values


def _codes(status: Array) -> Array:
    """Solver status names as codes."""
    codes = np.zeros(status.shape)
    for lane in np.flatnonzero(status != "ok"):
        codes[lane] = STATUS_CODES[status[lane]]
    return codes
