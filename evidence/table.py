"""Episodes as a table of records: columns of what is known of them, their labels and traces."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from integ_gym.envs.ops.ops import Array
from integ_gym.envs.settings import DISCRETIZATION, Setup
from integ_gym.envs.transition import STATUS_NAMES

from .episodes import EpisodeLog, Episodes, Layout
from .fields import SUMMARY_FIELDS, Field, staleness
from .labels import EpisodeContext, EpisodeFacts, Replays, failure_label
from .schema import arrow_schema, arrow_type, pyarrow

SetupOfLane = tuple[Setup, int]


ReplayLookup = Replays | Mapping[int, Replays]


ReplayLookups = ReplayLookup | Sequence[ReplayLookup]
"""What replays said, for all episodes or by episode index; or such for each context."""


_NOT_RUN = Replays()

_COURSE = {
    "episode_return": "return",
    **{name: name for name in ("success", "time", "solver_status", "saturated_share")},
    **{name: name for name in ("goal_reached", "goal_left", "goal_since")},
}
"""Facts of :class:`EpisodeFacts` that are summaries, to the summaries' names."""

_CIRCUMSTANCES = {
    field.name: field.origin.value
    for field in SUMMARY_FIELDS
    if field.origin is not None and field.name in (*DISCRETIZATION, "observation_noise")
}
"""What labels look at that is the same in all episodes of a setup."""


def _attribute(
    contexts: Sequence[EpisodeContext],
    episodes: Episodes,
    setups: Sequence[SetupOfLane],
    replays: ReplayLookups | None,
) -> dict[str, list[Any]]:
    """Label, reason and what they rest on, by field name; of equal episodes they are found once."""
    lookups: Sequence[ReplayLookup] = [context.replays for context in contexts]
    if replays is not None:
        alone = isinstance(replays, Replays | Mapping)
        lookups = [replays] * len(contexts) if alone else replays  # type: ignore[list-item,assignment]
    heads = episodes.heads
    own = {
        place: {name: value(*setups[place]) for name, value in _CIRCUMSTANCES.items()}
        for place in set(heads.setup)
    }
    courses = {fact: _values(episodes.summary[name]) for fact, name in _COURSE.items()}
    bits, rows = _bits(episodes), []
    homes: dict[Any, tuple[Replays, Replays]] = {}  # what was said, kept so that its id stays
    known: dict[Any, dict[str, Any]] = {}
    cases = zip(heads.context, heads.index, heads.setup, strict=True)
    for episode, (context, index, place) in enumerate(cases):
        lookup = lookups[context]
        said = lookup if isinstance(lookup, Replays) else lookup.get(index, _NOT_RUN)
        case = context, place, id(said)
        same = bits[episode], case
        if same not in known:
            if case not in homes:
                home = contexts[context].home(own[place]) if said.home is None else said.home
                homes[case] = said, replace(said, home=home)
            said = homes[case][1]
            course = {fact: values[episode] for fact, values in courses.items()}
            course["solver_status"] = STATUS_NAMES[course["solver_status"]]
            if own[place]["control_period"] is not None:  # rows of a fleet are float32
                decisions = int(episodes.summary["length"][episode])
                course["time"] = decisions * own[place]["control_period"]
            facts = EpisodeFacts(
                **course,
                observation_noise=own[place]["observation_noise"],
                staleness=staleness(setups[place][0]),
                homes=len(contexts[context].homes),
            )
            known[same] = {**failure_label(facts, said).columns(), **said.columns()}
        rows.append(known[same])
    return {name: [row[name] for row in rows] for name in rows[0]}


def _values(column: Array) -> list[Any]:
    """Python values; None for what is not finite."""
    values: list[Any] = column.tolist()
    if column.dtype.kind != "f" or np.isfinite(column).all():
        return values
    return [x if y else None for x, y in zip(values, np.isfinite(column).tolist(), strict=True)]


def _bits(episodes: Episodes) -> list[bytes]:
    """The courses of the episodes, of which those that are alike to the last bit are equal."""
    table = np.array([episodes.summary[name] for name in _COURSE.values()], dtype=np.float64)
    return table.T.copy().view(f"V{table.itemsize * len(table)}").ravel().tolist()


def build_unhashed_table(
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
    episodes, contexts, width = log.episodes(), [], setups[0][0].engine.width
    for context in log.contexts:
        known = [bits for bits in (context.float_width, width) if bits is not None]
        contexts.append(replace(context, float_width=min(known) if len(known) == 2 else None))
    columns = _summary_columns(contexts, episodes, setups)
    columns["env_id"] = pa.array([env_id] * len(episodes.heads))
    columns["content_hash"] = pa.array([""] * len(episodes.heads))
    for name, values in _attribute(contexts, episodes, setups, replays).items():
        columns[name] = pa.array(values, arrow_type(_KINDS[name]))
    columns |= _trace_columns(log.layout, episodes)
    table = pa.table(columns, schema=arrow_schema(log.layout.fields, env_id))
    order = np.lexsort((episodes.heads.index, episodes.heads.context))
    return table if (np.diff(order) > 0).all() else table.take(order)


_KINDS = {field.name: field.kind for field in SUMMARY_FIELDS}


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
            values = [origin.value(context) for context in contexts]
            columns[field.name] = pa.array(values, kind).take(pa.array(heads.context))
        else:
            of_setups = [origin.value(*setups[place]) for place in used]
            columns[field.name] = pa.array(of_setups, kind).take(pa.array(setup_of))
    return columns


def _of_rows(field: Field, values: Array) -> Any:
    """An Arrow array of what rows say; null for what is not finite."""
    pa, kind = pyarrow(), arrow_type(field.kind)
    if field.choices:
        return pa.array(np.array(field.choices, dtype=object)[values], kind)
    values = _clear_negative_zeros(values.copy())
    if values.ndim > 1:
        ends = np.arange(len(values) + 1, dtype=np.int32) * values.shape[1]
        return pa.ListArray.from_arrays(pa.array(ends), pa.array(values.ravel()), type=kind)
    known = np.isfinite(values)
    if known.all():
        return pa.array(values).cast(kind)
    return pa.array(np.where(known, values, 0.0), mask=~known).cast(kind)


def _trace_columns(layout: Layout, episodes: Episodes) -> Iterator[tuple[str, Any]]:
    """Name and lists of each trace column, one list per episode.

    It is null where an episode has no trace or the environment no such quantity.
    """
    pa = pyarrow()
    lengths = np.zeros(len(episodes.heads), dtype=np.int64)
    lengths[episodes.traced] = episodes.counts
    ends = np.concatenate(([0], np.cumsum(lengths)))
    last = ends[1:][lengths > 0] - 1  # rows that no step follows
    offsets = pa.array(ends, pa.int32())
    missing = None if episodes.traced.all() else pa.array(~episodes.traced)
    for field in layout.fields:
        if not field.at:
            continue
        kind, numbers = arrow_type(field.kind), _numbers(layout, episodes, field)
        if numbers is None:
            yield field.name, pa.nulls(len(lengths), kind)
            continue
        known, unknown = numbers, np.zeros(len(numbers), dtype=bool)
        if not np.isfinite(numbers).all():
            known, unknown = np.nan_to_num(numbers), np.isnan(numbers)
        if field.at == "step":
            unknown[last] = True
        known = known.astype(kind.value_type.to_pandas_dtype(), copy=False)
        values = pa.array(_clear_negative_zeros(known), mask=unknown if unknown.any() else None)
        yield field.name, pa.ListArray.from_arrays(offsets, values, type=kind, mask=missing)


def _numbers(layout: Layout, episodes: Episodes, field: Field) -> Array | None:
    """The rows' numbers, each with its control instant or the step that follows; a copy."""
    if field.source not in layout:
        return None
    parts = [rows[layout.place(field.source)] for rows in episodes.rows]
    if all(_unknown(part) for part in parts):
        return None
    return np.concatenate([*parts, [0.0]])[1:] if field.at == "step" else np.concatenate(parts)


def _clear_negative_zeros(numbers: Array) -> Array:
    """The same array, in which no zero is negative any more.

    Which sign it has hangs on how a step is compiled, and a content hash is not to.
    """
    if numbers.dtype.kind != "b":
        numbers += 0
    return numbers


def _unknown(numbers: Array) -> bool:
    return not numbers.size or bool(np.isnan(numbers[0]) and np.isnan(numbers).all())
