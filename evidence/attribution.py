"""Why an episode failed: replays under other conditions, and the label that they give."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from integ_gym.envs.settings import DISCRETIZATION, Setup
from integ_gym.envs.transition import STATUS_NAMES

from .context import EpisodeContext
from .descriptions import staleness
from .episode_log import Episodes
from .fields import SUMMARY_FIELDS
from .labels import Array, EpisodeFacts, Replays, failure_label

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
