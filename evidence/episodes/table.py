"""Finished episodes as an Arrow table of evidence records."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from integ_gym.envs import DISCRETIZATION, Setup

from ..schema import (
    SUMMARY_FIELDS,
    Field,
    arrow_schema,
    arrow_type,
    in_words,
    pyarrow,
    staleness,
    with_hashes,
)
from .context import EpisodeContext
from .episode_log import EpisodeHead, EpisodeLog, Episodes
from .labels import EpisodeFacts, Replays, failure_label
from .layout import Layout

Array = npt.NDArray[Any]
Columns = dict[str, Sequence[Any]]
SetupOfLane = tuple[Setup, int]

ReplayLookup = Replays | Mapping[int, Replays]

ReplayLookups = ReplayLookup | Sequence[ReplayLookup]
"""What replays said, for all episodes or by episode index; or such for each context."""


def record_table(
    log: EpisodeLog,
    env_id: str,
    setups: Sequence[SetupOfLane],
    replays: ReplayLookups | None = None,
) -> Any:
    """The records of a log's episodes.

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
    columns["env_id"] = [env_id] * len(episodes.heads)
    columns["content_hash"] = [""] * len(episodes.heads)
    attributed = list(_attributed(contexts, episodes, columns, setups, replays))
    columns.update({name: [own[name] for own in attributed] for name in attributed[0]})
    arrays = [
        _trace_array(log.layout, episodes, field)
        if field.at
        else pa.array(columns[field.name], type=arrow_type(field.kind))
        for field in fields
    ]
    table = pa.Table.from_arrays(arrays, schema=arrow_schema(fields, env_id))
    return with_hashes(_in_order(table, episodes.heads))


def _narrower(told: int | None, width: int | None) -> int | None:
    """Bits of the numbers that were computed with; None where the engine's are not known."""
    return None if told is None or width is None else min(told, width)


def _in_order(table: Any, heads: Sequence[EpisodeHead]) -> Any:
    order = np.lexsort(([head.index for head in heads], [head.context for head in heads]))
    return table if (np.diff(order) > 0).all() else table.take(order)


def _summary_columns(
    contexts: Sequence[EpisodeContext], episodes: Episodes, setups: Sequence[SetupOfLane]
) -> Columns:
    """Values of all fields that have an origin, by name."""
    heads, columns = episodes.heads, Columns()
    used = sorted({head.setup for head in heads})
    for field in SUMMARY_FIELDS:
        origin = field.origin
        if origin is None:
            continue
        if origin.of == "rows":
            values = _values(episodes.summary[field.name])
            columns[field.name] = [field.choices[x] for x in values] if field.choices else values
        elif origin.of == "head":
            columns[field.name] = [origin.value(head, contexts[head.context]) for head in heads]
        elif origin.of == "context":
            told = [origin.value(context) for context in contexts]
            columns[field.name] = [told[head.context] for head in heads]
        else:
            made = {place: origin.value(*setups[place]) for place in used}
            columns[field.name] = [made[head.setup] for head in heads]
    return columns


def _attributed(
    contexts: Sequence[EpisodeContext],
    episodes: Episodes,
    columns: Columns,
    setups: Sequence[SetupOfLane],
    replays: ReplayLookups | None,
) -> Iterator[dict[str, Any]]:
    """Label, reason and what they rest on, episode by episode."""
    given = {**{name: _values(values) for name, values in episodes.summary.items()}, **columns}
    lookups = _lookups(contexts, replays)
    for i, head in enumerate(episodes.heads):
        context, lookup = contexts[head.context], lookups[head.context]
        own = {name: columns[name][i] for name in DISCRETIZATION}
        facts = EpisodeFacts(
            goal=given["metric_definition"][i],
            discretization=in_words(own),
            episode_return=given["return"][i],
            staleness=staleness(setups[head.setup][0]),
            homes=len(context.homes),
            **{name: given[name][i] for name in _FACTS},
        )
        said = lookup if isinstance(lookup, Replays) else lookup.get(head.index, Replays())
        if said.home is None and (home := context.home(own)) is not None:
            said = replace(said, home=home)
        label, reason = failure_label(facts, said)
        yield {"failure_label": label, "failure_reason": reason, **said.columns()}


def _lookups(
    contexts: Sequence[EpisodeContext], replays: ReplayLookups | None
) -> Sequence[ReplayLookup]:
    """What replays said, context by context."""
    if replays is None:
        return [context.replays for context in contexts]
    if isinstance(replays, Replays | Mapping):
        return [replays] * len(contexts)
    return replays


_FACTS = (
    *("success", "terminated", "time", "solver_status", "saturated_share", "observation_noise"),
    *("goal_reached", "goal_left", "goal_since"),
)
"""Facts of :class:`EpisodeFacts` that a field or summary of the same name holds."""


def _values(column: Array) -> list[Any]:
    """Python values; None for what is not finite."""
    values: list[Any] = column.tolist()
    if column.dtype.kind != "f" or np.isfinite(column).all():
        return values
    return [x if y else None for x, y in zip(values, np.isfinite(column).tolist(), strict=True)]


def _trace_array(layout: Layout, episodes: Episodes, field: Field) -> Any:
    """One list per episode; null where it has no trace or the environment no such quantity."""
    pa = pyarrow()
    kind = arrow_type(field.kind)
    if field.source not in layout:
        return pa.nulls(len(episodes.heads), kind)
    numbers = episodes.rows[layout.place(field.source)]
    if not numbers.size or (np.isnan(numbers[0]) and np.isnan(numbers).all()):
        return pa.nulls(len(episodes.heads), kind)
    if field.at == "step":
        numbers = np.append(numbers[1:], 0.0)
    lengths = np.zeros(len(episodes.heads), dtype=np.int64)
    lengths[episodes.traced] = episodes.counts
    ends = np.concatenate(([0], np.cumsum(lengths)))
    finite = np.isfinite(numbers).all()
    unknown = np.zeros(len(numbers), dtype=bool) if finite else np.isnan(numbers)
    if field.at == "step":
        unknown[_last_rows(ends)] = True
    known = numbers if finite else np.nan_to_num(numbers)
    known = known.astype(kind.value_type.to_pandas_dtype(), copy=False)
    values = pa.array(known, mask=unknown if unknown.any() else None)
    missing = None if episodes.traced.all() else pa.array(~episodes.traced)
    return pa.ListArray.from_arrays(pa.array(ends, pa.int32()), values, type=kind, mask=missing)


def _last_rows(ends: Array) -> Array:
    """The last row of every episode that has some, which no step follows."""
    rows: Array = ends[1:][np.diff(ends) > 0] - 1
    return rows
