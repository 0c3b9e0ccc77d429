"""Summaries of many episodes at once, from their rows."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from ..schema.fields import SUMMARY_FIELDS
from .layout import Layout

Array = npt.NDArray[Any]

_TYPES = {"bool": np.bool_, "int64": np.int64, "string": np.int64}
"""By a field's kind; of a string, its place among the choices."""


def summarise(layout: Layout, rows: Array, counts: Array) -> dict[str, Array]:
    """One value per episode for every field that the rows decide.

    Args:
        layout: what the entries of a row are.
        rows: rows of whole episodes one after the other, shape (entries, sum of counts).
        counts: rows of each episode, at least 2, shape (episodes,).

    Returns:
        Arrays of shape (episodes,), by field name, ``solver_status`` as a code; ``time``,
        ``goal_reached``, ``goal_left`` and ``goal_since`` beside them. NaN where there is no value.
    """
    episodes = EpisodeRows(layout, rows, counts)
    values = {
        field.name: _typed(field.origin.value(episodes), field.kind)
        for field in SUMMARY_FIELDS
        if field.origin is not None and field.origin.of == "rows"
    }
    return {
        **values,
        "time": episodes.last("time"),
        "goal_reached": episodes.goal_reached(),
        "goal_left": episodes.goal_left(),
        "goal_since": episodes.goal_since(),
    }


def _typed(values: Array, kind: str) -> Array:
    """Numbers of a field's kind; NaN, which only floats have, where nothing is known."""
    known = values.dtype.kind != "f" or not np.isnan(values).any()
    return values.astype(_TYPES.get(kind, np.float64) if known else np.float64)


class EpisodeRows:
    """Rows of whole episodes one after the other; what is asked of them has shape (episodes,).

    Args:
        layout: what the entries of a row are.
        rows: shape (entries, sum of counts).
        counts: rows of each episode, at least 2, shape (episodes,).

    Attributes:
        steps: control steps of each episode.
    """

    def __init__(self, layout: Layout, rows: Array, counts: Array) -> None:
        self._layout = layout
        self._rows = rows
        self._ends = np.cumsum(counts)
        self._starts = self._ends - counts
        self.steps = counts - 1

    def total(self, entry: str, of: Callable[[Array], Array] = np.asarray) -> Array:
        """Sum of a function of an entry; NaN where there is no such entry."""
        return self._reduced(np.add, entry, of)

    def most(self, entry: str) -> Array:
        """Largest value of an entry; NaN where there is no such entry."""
        return self._reduced(np.maximum, entry)

    def first(self, entry: str) -> Array:
        """An entry at time 0."""
        values: Array = self._column(entry)[self._starts]
        return values

    def last(self, entry: str) -> Array:
        """An entry at the end."""
        values: Array = self._column(entry)[self._ends - 1]
        return values

    def falls(self, entry: str) -> Array:
        """How often an entry is 0 right after it was above."""
        column = self._column(entry)
        falls = self._each(np.add, self._fallen(column > 0.0).astype(np.int64))
        unknown = np.isnan(self._each(np.add, column))
        return np.where(unknown, np.nan, falls) if unknown.any() else falls

    def starts(self) -> Array:
        """True states at time 0, in state order, shape (episodes, states)."""
        if not self._layout.state:
            return np.empty((len(self.steps), 0))
        return np.stack([self.first(name) for name in self._layout.state], axis=1)

    def goal_since(self) -> Array:
        """Start of the stay at the goal in which the episode ends, s; NaN if it ends elsewhere."""
        since = self.last("goal_since")
        return np.where(since >= 0.0, since, np.nan)

    def time_to_success(self) -> Array:
        """The same of episodes that succeed, s; NaN of others."""
        return np.where(self.last("success") > 0.0, self.last("goal_since"), np.nan)

    def goal_reached(self) -> Array:
        """First time at the goal, s; NaN if never."""
        time = np.where(self._there(), self._column("time"), np.inf)
        return _finite(self._each(np.minimum, time))

    def at_arrival(self, entry: str) -> Array:
        """An entry at the first time at the goal; NaN without any."""
        arrival = self._arrival()
        never = arrival >= self._ends
        return np.where(never, np.nan, self._column(entry)[np.where(never, 0, arrival)])

    def until_arrival(self, entry: str) -> Array:
        """Sum of an entry up to the first time at the goal; NaN without any, or no such entry."""
        arrival = self._arrival()
        before = np.arange(self._ends[-1]) <= np.repeat(arrival, self.steps + 1)
        if entry not in self._layout:
            return np.full(len(self.steps), np.nan)
        until = self._each(np.add, np.where(before, self._column(entry), 0.0))
        return np.where(arrival < self._ends, until, np.nan)

    def goal_left(self) -> Array:
        """Last time of leaving the goal, s; NaN if never."""
        left = self._fallen(self._there())
        return _finite(self._each(np.maximum, np.where(left, self._column("time"), -np.inf)))

    def _arrival(self) -> Array:
        """Place of the first row at the goal; beyond all rows without any."""
        places = np.arange(self._ends[-1])
        return self._each(np.minimum, np.where(self._there(), places, self._ends[-1]))

    def _there(self) -> Array:
        there: Array = self._column("goal_since") >= 0.0
        return there

    def _fallen(self, flag: Array) -> Array:
        """Whether a flag is off in a row right after one of the same episode with it on."""
        fallen = np.zeros_like(flag)
        fallen[1:] = flag[:-1] & ~flag[1:]
        fallen[self._starts] = False
        return fallen

    def _column(self, entry: str) -> Array:
        column: Array = self._rows[self._layout.place(entry)]
        return column

    def _reduced(
        self, function: np.ufunc, entry: str, of: Callable[[Array], Array] = np.asarray
    ) -> Array:
        if entry not in self._layout:
            return np.full(len(self.steps), np.nan)
        return self._each(function, of(self._column(entry)))

    def _each(self, function: np.ufunc, column: Array) -> Array:
        values: Array = function.reduceat(column, self._starts)
        return values


def _finite(times: Array) -> Array:
    return np.where(np.isfinite(times), times, np.nan)
