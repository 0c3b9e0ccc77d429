"""The log of an episode's steps, and the columns that it makes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import lru_cache
from itertools import chain
from typing import Any

import numpy as np
import numpy.typing as npt

from integ_gym.envs.catalogue.lookup import environment_setup
from integ_gym.envs.ops.ops import SCALAR
from integ_gym.envs.registries import TRUTH
from integ_gym.envs.settings import NATIVE

from .context import EpisodeContext
from .layout import Layout, summarise
from .schema import argument_values

Array = npt.NDArray[Any]


@dataclass(frozen=True, slots=True)
class EpisodeHead:
    """What identifies an episode.

    Attributes:
        index: number of the episode in its cell.
        seed: seed given, or None.
        rng_key: see the record field of that name.
        wall_start: Unix time of its start, µs.
        wall_end: Unix time of its end, µs.
        setup: which of the environment's setups it ran on.
        context: which of the recorder's contexts it belongs to.
    """

    index: int
    seed: int | None
    rng_key: str
    wall_start: int
    wall_end: int
    setup: int = 0
    context: int = 0


@dataclass(frozen=True)
class EpisodeHeads:
    """What identifies episodes, column by column: see :class:`EpisodeHead`."""

    index: list[int]
    seed: list[int | None]
    rng_key: list[str]
    wall_start: list[int]
    wall_end: list[int]
    setup: list[int]
    context: list[int]

    @classmethod
    def of(cls, heads: Sequence[EpisodeHead]) -> EpisodeHeads:
        """Those of episodes one by one."""
        return cls(*([getattr(head, field.name) for head in heads] for field in fields(cls)))

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
        summary: see :func:`integ_gym.evidence.layout.summarise`.
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
        kept = sum(len(part.heads) for part in self._parts)
        return kept + sum(len(heads) for *_, heads in self._pending)

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
            self._parts = [_joined(self._parts)]
        return self._parts[0] if self._parts else _nothing(self.layout)

    def clear(self) -> None:
        """Forget them."""
        self._parts = []
        self._pending, self._pending_rows = [], 0

    def _summarise(self) -> None:
        """Summarise what is pending and drop the traces that are not wanted."""
        if not self._pending:
            return
        rows = _beside([rows for rows, *_ in self._pending])
        counts = np.concatenate([counts for _, counts, _ in self._pending])
        heads = EpisodeHeads.joined([heads for *_, heads in self._pending])
        owned = zip(heads.context, heads.index, strict=True)
        traced = np.array([self.contexts[context].has_trace(index) for context, index in owned])
        kept = rows if traced.all() else rows[:, np.repeat(traced, counts)]
        summary = summarise(self.layout, rows, counts)
        self._parts.append(Episodes(heads, summary, traced, (kept,), counts[traced]))
        self._pending, self._pending_rows = [], 0


def _joined(parts: list[Episodes]) -> Episodes:
    return Episodes(
        EpisodeHeads.joined([part.heads for part in parts]),
        {name: np.concatenate([p.summary[name] for p in parts]) for name in parts[0].summary},
        np.concatenate([part.traced for part in parts]),
        tuple(chain.from_iterable(part.rows for part in parts)),
        np.concatenate([part.counts for part in parts]),
    )


def _beside(rows: list[Array]) -> Array:
    return rows[0] if len(rows) == 1 else np.concatenate(rows, axis=1)


def _nothing(layout: Layout) -> Episodes:
    rows, counts = np.zeros((len(layout), 2)), np.array([2])
    summary = {name: x[:0] for name, x in summarise(layout, rows, counts).items()}
    nobody = EpisodeHeads.joined([])
    return Episodes(nobody, summary, np.zeros(0, dtype=bool), (rows[:, :0],), counts[:0])


@lru_cache(maxsize=256)
def told_setup(env_id: str, arguments: str) -> Any:
    """The setup of one of our tasks with its goal and times; no code that a record names is loaded.

    Args:
        env_id: one of integ-gym's environments.
        arguments: as a record has them.
    """
    given = {**argument_values(arguments), "engine": NATIVE, "integrator": TRUTH}
    return environment_setup(env_id, given)


def choices(task: Any, commanded: Array) -> Array:
    """Actions of a discrete set that ask for controls; NaN where none does, as in a fallback.

    Args:
        task: with ``discrete`` actions.
        commanded: controls, of any shape.
    """
    actions = np.full(commanded.shape, np.nan)
    for choice in range(task.discrete):
        actions[commanded == task.command(SCALAR, float(choice)).control] = choice
    return actions
