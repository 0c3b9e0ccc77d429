"""Where the values of a record's fields come from."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from operator import attrgetter
from typing import Any


@dataclass(frozen=True)
class Origin:
    """How the values of a field are found.

    Attributes:
        of: what they are read from: ``context``, an episode's
            :class:`~integ_gym.evidence.episodes.context.EpisodeContext`; ``setup``, its setup and
            lane; ``head``, the :class:`~integ_gym.evidence.episodes.episode_log.EpisodeHeads`
            of many episodes and all contexts; ``rows``, the
            :class:`~integ_gym.evidence.episodes.summary.EpisodeRows` of many episodes.
        value: function of that to the value; of many episodes to one value per episode, of rows
            as an array.
    """

    of: str
    value: Callable[..., Any]


def _origin(of: str, what: str | Callable[..., Any]) -> Origin:
    """``what``: a function, or the name of an attribute, with dots for one of an attribute."""
    if callable(what):
        return Origin(of, what)
    get = attrgetter(what)
    return Origin(of, lambda owner, *_: get(owner))


context = partial(_origin, "context")
"""Of what the recorder is told of the episodes."""

setup = partial(_origin, "setup")
"""Of the environment's setup, and the lane whose plant parameters hold."""

head = partial(_origin, "head")
"""Of what identifies the episodes, and all contexts."""

rows = partial(_origin, "rows")
"""Of the rows of whole episodes."""


def total(entry: str) -> Origin:
    """The sum of an entry over the episode."""
    return rows(lambda episodes: episodes.total(entry))


def most(entry: str) -> Origin:
    """The largest value of an entry."""
    return rows(lambda episodes: episodes.most(entry))


def first(entry: str) -> Origin:
    """An entry at time 0."""
    return rows(lambda episodes: episodes.first(entry))


def last(entry: str) -> Origin:
    """An entry at the end."""
    return rows(lambda episodes: episodes.last(entry))
