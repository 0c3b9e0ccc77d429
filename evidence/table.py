"""Episodes as a table of records: columns of what is known of them, their labels and traces."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from integ_gym.envs.settings import DISCRETIZATION, Setup
from integ_gym.envs.transition import STATUS_NAMES

from .episodes import Array, EpisodeHeads, EpisodeLog, Episodes, Layout
from .fields import SUMMARY_FIELDS, Field, staleness
from .hashing import with_hashes
from .labels import EpisodeContext, EpisodeFacts, Replays, failure_label
from .schema import arrow_schema, arrow_type, pyarrow

SetupOfLane = tuple[Setup, int]


ReplayLookup = Replays | Mapping[int, Replays]


ReplayLookups = ReplayLookup | Sequence[ReplayLookup]
"""What replays said, for all episodes or by episode index; or such for each context."""


_ORIGINS = {field.name: field.origin for field in SUMMARY_FIELDS if field.origin is not None}


_NOT_RUN = Replays()


_COURSE = {
    "episode_return": "return",
    **{
        name: name
        for name in (
            *("success", "time", "solver_status", "saturated_share"),
            *("goal_reached", "goal_left", "goal_since"),
        )
    },
}
"""Facts of :class:`EpisodeFacts` that are summaries, to the summaries' names."""


def attributed(
    contexts: Sequence[EpisodeContext],
    episodes: Episodes,
    setups: Sequence[SetupOfLane],
    replays: ReplayLookups | None,
) -> dict[str, Sequence[Any]]:
    """Label, reason and what they rest on, by field name.

    Args:
        contexts: what the episodes are for.
        episodes: finished episodes, at least one.
        setups: setups with the lane whose plant parameters hold.
        replays: overrides what the contexts say.
    """
    lookups, explanations = _lookups(contexts, replays), _Explanations(contexts, episodes, setups)
    rows = []
    owned = zip(episodes.heads.context, episodes.heads.index, strict=True)
    for episode, (context, index) in enumerate(owned):
        lookup = lookups[context]
        said = lookup if isinstance(lookup, Replays) else lookup.get(index, _NOT_RUN)
        rows.append(explanations.of(episode, said))
    return {name: [row[name] for row in rows] for name in rows[0]}


class _Explanations:
    """Explains episodes: those that are equal once."""

    def __init__(
        self,
        contexts: Sequence[EpisodeContext],
        episodes: Episodes,
        setups: Sequence[SetupOfLane],
    ) -> None:
        heads = episodes.heads
        self._contexts = contexts
        self._cases = list(zip(heads.context, heads.setup, strict=True))
        self._own = {setup: _circumstances(*setups[setup]) for setup in set(heads.setup)}
        self._courses = {fact: _values(episodes.summary[name]) for fact, name in _COURSE.items()}
        self._bits = _bits(episodes)
        self._homes: dict[Any, tuple[Replays, Replays]] = {}
        """What was said, kept so that its identity stays its own, and the same with the home."""
        self._known: dict[Any, dict[str, Any]] = {}

    def of(self, episode: int, said: Replays) -> dict[str, Any]:
        """Label, reason and the columns of what replays said."""
        case = (*self._cases[episode], id(said))
        same = (self._bits[episode], case)
        if same not in self._known:
            if case not in self._homes:
                self._homes[case] = said, self._with_home(*self._cases[episode], said)
            said = self._homes[case][1]
            failure = failure_label(self._facts(episode), said)
            self._known[same] = {**failure.columns(), **said.columns()}
        return self._known[same]

    def _with_home(self, context: int, setup: int, said: Replays) -> Replays:
        """With whether the episode ran at home, where that needs no replay."""
        home = self._contexts[context].home(self._own[setup]) if said.home is None else None
        return said if home is None else replace(said, home=home)

    def _facts(self, episode: int) -> EpisodeFacts:
        context, setup = self._cases[episode]
        own = self._own[setup]
        course = {fact: values[episode] for fact, values in self._courses.items()}
        course["solver_status"] = STATUS_NAMES[course["solver_status"]]
        return EpisodeFacts(
            **course,
            observation_noise=own["observation_noise"],
            staleness=own["staleness"],
            homes=len(self._contexts[context].homes),
        )


def _circumstances(setup: Setup, lane: int) -> dict[str, Any]:
    """What labels look at that is the same in all episodes of a setup."""
    names = (*DISCRETIZATION, "observation_noise")
    own = {name: _ORIGINS[name].value(setup, lane) for name in names}
    return {**own, "staleness": staleness(setup)}


def _lookups(
    contexts: Sequence[EpisodeContext], replays: ReplayLookups | None
) -> Sequence[ReplayLookup]:
    """What replays said, context by context."""
    if replays is None:
        return [context.replays for context in contexts]
    if isinstance(replays, Replays | Mapping):
        return [replays] * len(contexts)
    return replays


def _values(column: Array) -> list[Any]:
    """Python values; None for what is not finite."""
    values: list[Any] = column.tolist()
    if column.dtype.kind != "f" or np.isfinite(column).all():
        return values
    return [x if y else None for x, y in zip(values, np.isfinite(column).tolist(), strict=True)]


def _bits(episodes: Episodes) -> list[bytes]:
    """The courses of the episodes, of which those that are alike to the last bit are equal."""
    table = np.array([episodes.summary[name] for name in _COURSE.values()], dtype=np.float64)
    rows: list[bytes] = table.T.copy().view(f"V{table.itemsize * len(table)}").ravel().tolist()
    return rows


def record_table(
    log: EpisodeLog,
    env_id: str,
    setups: Sequence[SetupOfLane],
    replays: ReplayLookups | None = None,
) -> Any:
    """The records of a log's episodes; see :func:`unhashed_table`."""
    return with_hashes(unhashed_table(log, env_id, setups, replays))


def unhashed_table(
    log: EpisodeLog,
    env_id: str,
    setups: Sequence[SetupOfLane],
    replays: ReplayLookups | None = None,
) -> Any:
    """The records of a log's episodes, whose content hashes are empty.

    Args:
        log: the finished episodes, at least one.
        env_id: Gymnasium id of the environment.
        setups: what ``setup`` of an episode's head counts: setups with the lane whose plant
            parameters hold.
        replays: overrides what the contexts say.

    Returns:
        An Arrow table with the schema of that environment's records, by context and episode index.
    """
    pa = pyarrow()
    episodes, fields = log.episodes(), log.layout.fields
    width = setups[0][0].engine.width
    contexts = [replace(c, float_width=_narrower(c.float_width, width)) for c in log.contexts]
    columns = _summary_columns(contexts, episodes, setups)
    columns["env_id"] = pa.array([env_id] * len(episodes.heads))
    columns["content_hash"] = pa.array([""] * len(episodes.heads))
    for name, values in attributed(contexts, episodes, setups, replays).items():
        columns[name] = pa.array(values, arrow_type(_KINDS[name]))
    trace = _Trace(log.layout, episodes)
    arrays = [trace.column(field) if field.at else columns[field.name] for field in fields]
    table = pa.Table.from_arrays(arrays, schema=arrow_schema(fields, env_id))
    return _in_order(table, episodes.heads)


_KINDS = {field.name: field.kind for field in SUMMARY_FIELDS}


def _narrower(told: int | None, width: int | None) -> int | None:
    """Bits of the numbers that were computed with; None where the engine's are not known."""
    return None if told is None or width is None else min(told, width)


def _in_order(table: Any, heads: EpisodeHeads) -> Any:
    order = np.lexsort((heads.index, heads.context))
    return table if (np.diff(order) > 0).all() else table.take(order)


def _summary_columns(
    contexts: Sequence[EpisodeContext], episodes: Episodes, setups: Sequence[SetupOfLane]
) -> dict[str, Any]:
    """Arrow arrays of all fields that have an origin, by name."""
    pa = pyarrow()
    heads, columns = episodes.heads, {}
    used, setup_of = np.unique(heads.setup, return_inverse=True)
    for field in SUMMARY_FIELDS:
        origin, kind = field.origin, arrow_type(field.kind)
        if origin is None:
            continue
        if origin.of == "rows":
            columns[field.name] = _of_rows(field, episodes.summary[field.name])
        elif origin.of == "head":
            columns[field.name] = pa.array(origin.value(heads, contexts), kind)
        elif origin.of == "context":
            told = [origin.value(context) for context in contexts]
            columns[field.name] = pa.array(told, kind).take(pa.array(heads.context))
        else:
            made = [origin.value(*setups[place]) for place in used]
            columns[field.name] = pa.array(made, kind).take(pa.array(setup_of))
    return columns


def _of_rows(field: Field, values: Array) -> Any:
    """An Arrow array of what rows say; null for what is not finite."""
    pa, kind = pyarrow(), arrow_type(field.kind)
    if field.choices:
        return pa.array(np.array(field.choices, dtype=object)[values], kind)
    values = _unsigned(values.copy())
    if values.ndim > 1:
        ends = np.arange(len(values) + 1, dtype=np.int32) * values.shape[1]
        return pa.ListArray.from_arrays(pa.array(ends), pa.array(values.ravel()), type=kind)
    known = np.isfinite(values)
    if known.all():
        return pa.array(values).cast(kind)
    return pa.array(np.where(known, values, 0.0), mask=~known).cast(kind)


class _Trace:
    """Makes trace columns.

    Args:
        layout: what the entries of a row are.
        episodes: finished episodes.
    """

    def __init__(self, layout: Layout, episodes: Episodes) -> None:
        self._layout = layout
        self._rows = episodes.rows
        self._episodes = len(episodes.heads)
        lengths = np.zeros(self._episodes, dtype=np.int64)
        lengths[episodes.traced] = episodes.counts
        ends = np.concatenate(([0], np.cumsum(lengths)))
        self._last = ends[1:][lengths > 0] - 1
        """The last row of every episode that has some, which no step follows."""
        self._ends = pyarrow().array(ends, pyarrow().int32())
        self._missing = None if episodes.traced.all() else pyarrow().array(~episodes.traced)

    def column(self, field: Field) -> Any:
        """One list per episode; null where it has no trace or the environment no such quantity."""
        pa, kind = pyarrow(), arrow_type(field.kind)
        numbers = self._numbers(field)
        if numbers is None:
            return pa.nulls(self._episodes, kind)
        known, unknown = numbers, np.zeros(len(numbers), dtype=bool)
        if not np.isfinite(numbers).all():
            known, unknown = np.nan_to_num(numbers), np.isnan(numbers)
        if field.at == "step":
            unknown[self._last] = True
        known = known.astype(kind.value_type.to_pandas_dtype(), copy=False)
        values = pa.array(_unsigned(known), mask=unknown if unknown.any() else None)
        return pa.ListArray.from_arrays(self._ends, values, type=kind, mask=self._missing)

    def _numbers(self, field: Field) -> Array | None:
        """The rows' numbers, each with its control instant or the step that follows; a copy."""
        if field.source not in self._layout:
            return None
        parts = [rows[self._layout.place(field.source)] for rows in self._rows]
        if all(_unknown(part) for part in parts):
            return None
        if field.at == "step":
            return np.concatenate([*parts, [0.0]])[1:]
        return np.concatenate(parts)


def _unsigned(numbers: Array) -> Array:
    """The same array, in which no zero is negative any more.

    Which sign it has hangs on how a step is compiled, and a content hash is not to.
    """
    if numbers.dtype.kind != "b":
        numbers += 0
    return numbers


def _unknown(numbers: Array) -> bool:
    return not numbers.size or bool(np.isnan(numbers[0]) and np.isnan(numbers).all())
