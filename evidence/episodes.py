"""Finished episodes: the rows that their steps are recorded as, and what they add up to."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import lru_cache
from itertools import chain
from math import nan
from operator import itemgetter
from typing import Any

import numpy as np

from integ_gym.envs.environment import environment_setup
from integ_gym.envs.foreign import FURTHER
from integ_gym.envs.ops.ops import SCALAR, Array
from integ_gym.envs.plants.interface import state_names
from integ_gym.envs.registries import TRUTH
from integ_gym.envs.settings import NATIVE

from .fields import CONTACT_TRACE, SUMMARY_FIELDS, Field, further_of, record_fields
from .labels import EpisodeContext
from .schema import argument_values

STATUS = "solver_status"
"""The solver's status, as a code."""

_ENDING = ("reward", "terminated", "truncated")

_FOR_SUMMARIES = ("goal_since", "saturated", "fallback_used", "success")
"""What is taken from ``info`` beside what trace columns are made of."""

_PERHAPS_UNKNOWN = dict.fromkeys(("dissipated", "energy_residual"), nan)
"""What an environment leaves out of `info` where it is not known."""

COMMANDED, MEASURED = "command_", "measured_"
"""Prefixes of the further columns that hold a command, and of those that hold its measurement."""

_STARTING = ("energy", "goal_since")
"""What of ``info`` is not 0 at a reset."""


class Layout:
    """Entries of a row, in order.

    Row 0 of an episode is its reset and row k the result of its control step k - 1: the state,
    observation and times at the instant after that step, and what was booked during it. All
    entries fit a float64 exactly.

    Args:
        plant: plant or plant class.
        task: task or task class.
        info: what a reset gives as ``info``; tells whether the environment has contact.

    Attributes:
        fields: all columns of the records.
        info: entries taken from ``info``: what the trace columns and the summaries need.
        state: entries of the true state, in state order.
        further: entries that ``info`` has in one array, see
            :data:`integ_gym.envs.foreign.FURTHER`.
        names: all entries: ``info``, then solver status, reward, terminated and truncated, then
            ``state``, the observation and ``further``.
    """

    def __init__(self, plant: Any, task: Any, info: Mapping[str, Any] | None = None) -> None:
        self.fields: tuple[Field, ...] = record_fields(plant, task)
        self.state = state_names(plant)
        sensed = tuple(f"sensed_{name}" for name in task.observation_names)
        self.further = tuple(names.name for names in further_of(plant))
        others = (STATUS, *_ENDING, *self.state, *sensed, *self.further)
        absent = {field.source for field in CONTACT_TRACE} - set(info or ())
        sources = (field.source for field in self.fields if field.at)
        names = dict.fromkeys((*sources, *_FOR_SUMMARIES))
        self.info = tuple(name for name in names if name not in (*others, *absent))
        self.names = (*self.info, *others)
        self._places = {name: place for place, name in enumerate(self.names)}
        self._starting = [self._places[name] for name in (*_STARTING, *self.state, *sensed)]
        self._take_info = itemgetter(*self.info)

    def __len__(self) -> int:
        return len(self.names)

    def __contains__(self, name: str) -> bool:
        return name in self._places

    def place(self, name: str) -> int:
        """Where an entry is in the row."""
        return self._places[name]

    def row(
        self,
        info: Mapping[str, Any],
        status: Any,
        ending: tuple[Any, Any, Any],
        state: Iterable[Any],
        sensed: Iterable[Any],
    ) -> tuple[Any, ...]:
        """The entries of a row: numbers, or arrays of many rows.

        Args:
            info: of the environment.
            status: code of the solver's status.
            ending: reward, terminated, truncated.
            state: true state, component by component, in state order.
            sensed: observation, component by component.
        """
        try:
            values = self._take_info(info)
        except KeyError:
            values = self._take_info({**_PERHAPS_UNKNOWN, **info})
        further = info[FURTHER].T if self.further else ()
        return (*values, status, *ending, *state, *sensed, *further)

    def start(
        self, info: Mapping[str, Any], state: Iterable[Any], sensed: Iterable[Any]
    ) -> tuple[Any, ...]:
        """The entries of a reset's row that are not 0, as :meth:`row`; of the status see there."""
        return (*(info[name] for name in _STARTING), *state, *sensed)

    def start_rows(self, entries: Array, status: int | Array) -> Array:
        """Whole rows of resets.

        Args:
            entries: see :meth:`start`, shape (entries, resets).
            status: code of the solver's status where no step has been taken, one or of each.

        Returns:
            Shape (all entries, resets).
        """
        rows = np.zeros((len(self), entries.shape[1]))
        rows[self._starting] = entries
        rows[self._places[STATUS]] = status
        return rows


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
        field.name: _cast_to_kind(field.origin.value(episodes), field.kind)
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


def _cast_to_kind(values: Array, kind: str) -> Array:
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
        return self._reduce(np.add, entry, of)

    def most(self, entry: str) -> Array:
        """Largest value of an entry; NaN where there is no such entry."""
        return self._reduce(np.maximum, entry)

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
        falls = self._each(np.add, self._falling_edge(column > 0.0).astype(np.int64))
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
        until = self.total(entry, lambda column: np.where(before, column, 0.0))
        return np.where(arrival < self._ends, until, np.nan)

    def command_error(self) -> Array:
        """Root mean square of commanded minus measured values; NaN where nothing is measured."""
        measured = [name for name in self._layout.further if name.startswith(MEASURED)]
        if not measured:
            return np.full(len(self.steps), np.nan)
        squares = np.zeros(self._ends[-1])
        for name in measured:
            wanted = self._column(COMMANDED + name.removeprefix(MEASURED))
            squares += (self._column(name) - wanted) ** 2
        squares[self._starts] = 0.0  # what a reset returned is not recorded
        error: Array = np.sqrt(self._each(np.add, squares) / self.steps)
        return error

    def goal_left(self) -> Array:
        """Last time of leaving the goal, s; NaN if never."""
        left = self._falling_edge(self._there())
        return _finite(self._each(np.maximum, np.where(left, self._column("time"), -np.inf)))

    def _arrival(self) -> Array:
        """Place of the first row at the goal; beyond all rows without any."""
        places = np.arange(self._ends[-1])
        return self._each(np.minimum, np.where(self._there(), places, self._ends[-1]))

    def _there(self) -> Array:
        return self._column("goal_since") >= 0.0

    def _falling_edge(self, flag: Array) -> Array:
        """Whether a flag is off in a row right after one of the same episode with it on."""
        fallen = np.zeros_like(flag)
        fallen[1:] = flag[:-1] & ~flag[1:]
        fallen[self._starts] = False
        return fallen

    def _column(self, entry: str) -> Array:
        column: Array = self._rows[self._layout.place(entry)]
        return column

    def _reduce(
        self, function: np.ufunc, entry: str, of: Callable[[Array], Array] = np.asarray
    ) -> Array:
        if entry not in self._layout:
            return np.full(len(self.steps), np.nan)
        return self._each(function, of(self._column(entry)))

    def _each(self, function: np.ufunc, column: Array) -> Array:
        return function.reduceat(column, self._starts)


def _finite(times: Array) -> Array:
    return np.where(np.isfinite(times), times, np.nan)


@dataclass(frozen=True)
class EpisodeHeads:
    """What identifies episodes, column by column.

    Attributes:
        index: number of the episode in its cell.
        seed: seed given, or None.
        rng_key: see the record field of that name.
        wall_start: Unix time of its start, µs.
        wall_end: Unix time of its end, µs.
        setup: which of the environment's setups it ran on.
        context: which of the recorder's contexts it belongs to.
    """

    index: list[int]
    seed: list[int | None]
    rng_key: list[str]
    wall_start: list[int]
    wall_end: list[int]
    setup: list[int]
    context: list[int]

    @classmethod
    def of_one(cls, *values: Any) -> EpisodeHeads:
        """Those of a single episode."""
        return cls(*([value] for value in values))

    @classmethod
    def joined(cls, parts: Sequence[EpisodeHeads]) -> EpisodeHeads:
        """One after the other."""
        columns = ([getattr(part, field.name) for part in parts] for field in fields(cls))
        return cls(*(list(chain.from_iterable(column)) for column in columns))

    def __len__(self) -> int:
        return len(self.index)


@dataclass(frozen=True)
class Episodes:
    """Finished episodes as columns.

    Attributes:
        heads: what identifies them.
        summary: see :func:`integ_gym.evidence.episodes.summarise`.
        traced: whether an episode has a trace, shape (episodes,).
        rows: rows of those that have, in parts of shape (entries, rows of some episodes).
        counts: rows of each of those, shape (episodes with a trace,).
    """

    heads: EpisodeHeads
    summary: dict[str, Array]
    traced: Array
    rows: tuple[Array, ...]
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
        self._pending: list[tuple[Array, Array, EpisodeHeads]] = []
        self._pending_rows = 0

    def __len__(self) -> int:
        count = sum(len(part.heads) for part in self._parts)
        return count + sum(len(heads) for *_, heads in self._pending)

    def add(self, rows: Array, counts: Array, heads: EpisodeHeads) -> None:
        """Take in whole episodes, at least one.

        Args:
            rows: their rows one after the other, shape (entries, sum of counts); not to be changed
                afterwards.
            counts: rows of each, its reset included, shape (episodes,).
            heads: what identifies them.
        """
        self._pending.append((rows, counts, heads))
        self._pending_rows += rows.shape[1]
        if self._pending_rows >= self._rows_at_once:
            self._summarise()

    def episodes(self) -> Episodes:
        """All episodes so far, in the order in which they came."""
        self._summarise()
        if len(self._parts) > 1:
            self._parts = [_join(self._parts)]
        return self._parts[0] if self._parts else _empty_episodes(self.layout)

    def clear(self) -> None:
        """Forget them."""
        self._parts = []
        self._pending, self._pending_rows = [], 0

    def _summarise(self) -> None:
        """Summarise what is pending and drop the traces that are not wanted."""
        if not self._pending:
            return
        parts = [rows for rows, *_ in self._pending]
        rows = parts[0] if len(parts) == 1 else np.concatenate(parts, axis=1)
        counts = np.concatenate([counts for _, counts, _ in self._pending])
        heads = EpisodeHeads.joined([heads for *_, heads in self._pending])
        owned = zip(heads.context, heads.index, strict=True)
        traced = np.array([self.contexts[context].has_trace(index) for context, index in owned])
        traces = rows if traced.all() else rows[:, np.repeat(traced, counts)]
        summary = summarise(self.layout, rows, counts)
        self._parts.append(Episodes(heads, summary, traced, (traces,), counts[traced]))
        self._pending, self._pending_rows = [], 0


def _join(parts: list[Episodes]) -> Episodes:
    return Episodes(
        EpisodeHeads.joined([part.heads for part in parts]),
        {name: np.concatenate([p.summary[name] for p in parts]) for name in parts[0].summary},
        np.concatenate([part.traced for part in parts]),
        tuple(chain.from_iterable(part.rows for part in parts)),
        np.concatenate([part.counts for part in parts]),
    )


def _empty_episodes(layout: Layout) -> Episodes:
    rows, counts = np.zeros((len(layout), 2)), np.array([2])
    summary = {name: x[:0] for name, x in summarise(layout, rows, counts).items()}
    no_heads = EpisodeHeads.joined([])
    return Episodes(no_heads, summary, np.zeros(0, dtype=bool), (rows[:, :0],), counts[:0])


@lru_cache(maxsize=256)
def native_setup(env_id: str, arguments: str) -> Any:
    """The setup of one of our tasks with its goal and times; no code that a record names is loaded.

    Args:
        env_id: one of integ-gym's environments.
        arguments: as a record has them.
    """
    given = {**argument_values(arguments), "engine": NATIVE, "integrator": TRUTH, "solver": None}
    return environment_setup(env_id, given)


def choices(task: Any, commanded: Array) -> Array:
    """Actions of a discrete set that ask for controls; NaN where none does, as in a fallback.

    Args:
        task: with ``discrete`` actions.
        commanded: controls, of any shape.
    """
    actions = np.full(commanded.shape, np.nan)
    for choice in range(task.discrete):
        actions[commanded == task.command(SCALAR, (float(choice),)).controls[0]] = choice
    return actions
