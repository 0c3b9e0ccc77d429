"""Labels and reasons of many episodes at once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt

from integ_gym.envs import DISCRETIZATION, STATUS_NAMES, Setup

from ..schema import SUMMARY_FIELDS, in_words, staleness
from .context import EpisodeContext
from .episode_log import Episodes
from .labels import EpisodeFacts, Replays, failure_label

Array = npt.NDArray[Any]
SetupOfLane = tuple[Setup, int]

ReplayLookup = Replays | Mapping[int, Replays]

ReplayLookups = ReplayLookup | Sequence[ReplayLookup]
"""What replays said, for all episodes or by episode index; or such for each context."""

_ORIGINS = {field.name: field.origin for field in SUMMARY_FIELDS if field.origin is not None}

_COURSE = {
    "episode_return": "return",
    **{
        name: name
        for name in (
            *("success", "terminated", "time", "solver_status", "saturated_share"),
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
    """Label, reason and what they rest on, by field name; equal episodes are explained once.

    Args:
        contexts: what the episodes are for.
        episodes: finished episodes, at least one.
        setups: setups with the lane whose plant parameters hold.
        replays: overrides what the contexts say.
    """

    @cache
    def of_setup(setup: int) -> dict[str, Any]:
        return _circumstances(*setups[setup])

    @cache
    def with_home(context: int, setup: int, said: Replays) -> Replays:
        home = contexts[context].home(of_setup(setup)) if said.home is None else None
        return said if home is None else replace(said, home=home)

    def explained(episode: int, context: int, setup: int, said: Replays) -> tuple[Any, ...]:
        own = of_setup(setup)
        course = {fact: values[episode] for fact, values in courses.items()}
        facts = EpisodeFacts(
            **{**course, "solver_status": STATUS_NAMES[course["solver_status"]]},
            goal=own["metric_definition"],
            discretization=own["in_words"],
            observation_noise=own["observation_noise"],
            staleness=own["staleness"],
            homes=len(contexts[context].homes),
        )
        return (*failure_label(facts, said), *said.columns().values())

    courses = {fact: _values(episodes.summary[name]) for fact, name in _COURSE.items()}
    lookups = _lookups(contexts, replays)
    known: dict[Any, tuple[Any, ...]] = {}
    rows = []
    heads = episodes.heads
    columns = zip(heads.index, heads.context, heads.setup, _bits(episodes), strict=True)
    for episode, (index, context, setup, bits) in enumerate(columns):
        lookup = lookups[context]
        said = lookup if isinstance(lookup, Replays) else lookup.get(index, Replays())
        said = with_home(context, setup, said)
        same = (bits, context, setup, said)
        if same not in known:
            known[same] = explained(episode, context, setup, said)
        rows.append(known[same])
    names = ("failure_label", "failure_reason", *Replays().columns())
    return dict(zip(names, zip(*rows, strict=True), strict=True))


def _circumstances(setup: Setup, lane: int) -> dict[str, Any]:
    """What labels look at that is the same in all episodes of a setup."""
    names = (*DISCRETIZATION, "metric_definition", "observation_noise")
    own = {name: _ORIGINS[name].value(setup, lane) for name in names}
    return {**own, "in_words": in_words(own), "staleness": staleness(setup)}


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
