"""Finished episodes as an Arrow table of evidence records."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from integ_gym.envs.settings import Setup
from integ_gym.envs.transition import STATUS_NAMES
from integ_gym.evidence.arrow_schema import arrow_schema, arrow_type
from integ_gym.evidence.content_hash import with_hashes
from integ_gym.evidence.context import EpisodeContext, json_text
from integ_gym.evidence.description import describe, in_words, staleness
from integ_gym.evidence.episode_log import EpisodeHead, EpisodeLog, Episodes
from integ_gym.evidence.extra import pyarrow
from integ_gym.evidence.fields import SCHEMA_VERSION, Field
from integ_gym.evidence.labels import EpisodeFacts, Replays, failure_label
from integ_gym.evidence.layout import Layout
from integ_gym.evidence.provenance import host, package_versions

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
        log: the finished episodes.
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
    contexts = [replace(c, float_width=min(c.float_width, width)) for c in log.contexts]
    columns = _scalar_columns(contexts, episodes, env_id, setups, replays)
    arrays = [
        _trace_array(log.layout, episodes, field)
        if field.at
        else _array(columns[field.name], field)
        for field in fields
    ]
    table = pa.Table.from_arrays(arrays, schema=arrow_schema(fields, env_id))
    return with_hashes(_in_order(table, episodes.heads))


def _in_order(table: Any, heads: Sequence[EpisodeHead]) -> Any:
    order = np.lexsort(([head.index for head in heads], [head.context for head in heads]))
    return table if (np.diff(order) > 0).all() else table.take(order)


def _scalar_columns(
    contexts: Sequence[EpisodeContext],
    episodes: Episodes,
    env_id: str,
    setups: Sequence[SetupOfLane],
    replays: ReplayLookups | None,
) -> Columns:
    heads, summary = episodes.heads, episodes.summary
    used = {head.setup for head in heads}
    descriptions = {k: describe(*setups[k]) for k in used}
    stale = {k: staleness(setups[k][0]) for k in used}
    described = [descriptions[head.setup] for head in heads]
    names = describe(*setups[0])
    labels = _labels(contexts, episodes, described, [stale[h.setup] for h in heads], replays)
    told = [_told(context, env_id) for context in contexts]
    return {
        **{name: [told[head.context][name] for head in heads] for name in told[0]},
        **{name: [description[name] for description in described] for name in names},
        **{name: _values(column) for name, column in summary.items()},
        "record_id": [contexts[head.context].record_id(head.index) for head in heads],
        "episode_index": [head.index for head in heads],
        "seed": [_small(head.seed) for head in heads],
        "rng_key": [head.rng_key for head in heads],
        "wall_start": [head.wall_start for head in heads],
        "wall_end": [head.wall_end for head in heads],
        "solver_status": [STATUS_NAMES[code] for code in summary["status_code"]],
        "failure_label": [label for label, _ in labels],
        "failure_reason": [reason for _, reason in labels],
        "content_hash": [""] * len(heads),
    }


def _told(context: EpisodeContext, env_id: str) -> dict[str, Any]:
    """What all episodes of a context have in common."""

    def optional(value: Any) -> str | None:
        return None if value is None else json_text(value)

    return {
        "schema_version": SCHEMA_VERSION,
        "run_id": context.run_id,
        "phase": context.phase,
        "env_id": env_id,
        "cell": context.cell,
        "policy_id": context.policy_id,
        "policy_hash": context.policy_hash,
        "training_discretization": optional(context.training_discretization),
        "training_seed": context.training_seed,
        "perturbation": optional(context.perturbation),
        "trace_every": context.trace_every,
        "float_width": context.float_width,
        "package_versions": json_text(package_versions(context.packages)),
        "platform": host(),
        "inference_latency_mean": context.inference_latency_mean,
        "inference_latency_p99": context.inference_latency_p99,
    }


def _labels(
    contexts: Sequence[EpisodeContext],
    episodes: Episodes,
    described: list[dict[str, Any]],
    stale: list[float],
    replays: ReplayLookups | None,
) -> list[tuple[str, str]]:
    columns = {fact: _values(episodes.summary[name]) for fact, name in _FACTS.items()}
    lookups = _lookups(contexts, replays)
    labels = []
    for i, (head, description) in enumerate(zip(episodes.heads, described, strict=True)):
        facts = EpisodeFacts(
            goal=description["metric_definition"],
            discretization=in_words(description),
            observation_noise=description["observation_noise"],
            staleness=stale[i],
            homes=len(contexts[head.context].homes),
            solver_status=STATUS_NAMES[episodes.summary["status_code"][i]],
            **{name: values[i] for name, values in columns.items()},
        )
        given = lookups[head.context]
        said = given if isinstance(given, Replays) else given.get(head.index, Replays())
        home = contexts[head.context].home(description) if said.home is None else said.home
        said = Replays(home, said.without_noise, said.without_delay)
        labels.append(failure_label(facts, said))
    return labels


def _lookups(
    contexts: Sequence[EpisodeContext], replays: ReplayLookups | None
) -> Sequence[ReplayLookup]:
    """What replays said, context by context."""
    if replays is None:
        return [context.replays for context in contexts]
    if isinstance(replays, Replays | Mapping):
        return [replays] * len(contexts)
    return replays


_FACTS = {
    "success": "success",
    "time": "time",
    "episode_return": "return",
    "saturated_share": "saturated_share",
    "goal_reached": "goal_reached",
    "goal_left": "goal_left",
    "goal_since": "goal_since",
    "terminated": "terminated",
}
"""Facts of :class:`EpisodeFacts` to the summary that holds them."""


def _values(column: Array) -> list[Any]:
    """Python values; None for what is not finite."""
    values: list[Any] = column.tolist()
    if column.dtype.kind != "f" or np.isfinite(column).all():
        return values
    return [x if y else None for x, y in zip(values, np.isfinite(column).tolist(), strict=True)]


def _small(seed: int | None) -> int | None:
    return seed if seed is not None and -(2**63) <= seed < 2**63 else None


def _array(values: Sequence[Any], field: Field) -> Any:
    return pyarrow().array(values, type=arrow_type(field.kind))


def _trace_array(layout: Layout, episodes: Episodes, field: Field) -> Any:
    """One list per episode; null where it has no trace or the environment no such quantity."""
    pa = pyarrow()
    kind = arrow_type(field.kind)
    if field.source not in layout:
        return pa.nulls(len(episodes.heads), kind)
    numbers = episodes.rows[layout.place(field.source)]
    if field.at == "step":
        numbers = np.append(numbers[1:], 0.0)
    numbers = numbers.astype(kind.value_type.to_pandas_dtype(), copy=False)
    lengths = np.zeros(len(episodes.heads), dtype=np.int64)
    lengths[episodes.traced] = episodes.counts
    ends = np.concatenate(([0], np.cumsum(lengths)))
    values = pa.array(numbers, mask=_absent(numbers, ends) if field.at == "step" else None)
    missing = None if episodes.traced.all() else pa.array(~episodes.traced)
    return pa.ListArray.from_arrays(pa.array(ends, pa.int32()), values, type=kind, mask=missing)


def _absent(numbers: Array, ends: Array) -> Array:
    """True where there is no value: NaN, and the last row of an episode, which no step follows."""
    mask = np.isnan(numbers)
    mask[ends[1:][np.diff(ends) > 0] - 1] = True
    return mask
