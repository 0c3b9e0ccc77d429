"""Episodes as columns: the logs of several lanes, one after the other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from .attribution import ReplayLookups, SetupOfLane, attributed
from .context import EpisodeContext
from .episode_log import Array, EpisodeHeads, EpisodeLog, Episodes
from .fields import SUMMARY_FIELDS, Field
from .hashing import with_hashes
from .layout import Layout
from .schema import arrow_schema, arrow_type, pyarrow


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
