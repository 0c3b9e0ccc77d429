"""Evidence of training episodes, from the rollouts of a fleet."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from integ_gym.envs.settings import Setup
from integ_gym.envs.transition import quiet_status
from integ_gym.evidence.episodes import EpisodeHead, EpisodeHeads, EpisodeLog, Layout
from integ_gym.evidence.recorder import now
from integ_gym.evidence.store import EvidenceStore
from integ_gym.evidence.table import unhashed_table
from integ_gym.support.optional import installed_versions

from ..config import TrainingEvidence

Array = NDArray[Any]


ROWS_AT_ONCE = 1 << 13
"""Rows of finished episodes that are summarised together, for each policy."""


class _Found(NamedTuple):
    """A whole episode: where in the rollout it ended, its rows, and which setup it ran on."""

    step: int
    lane: int
    rows: int
    setup: int


class EpisodeAssembler:
    """Puts the steps of one policy's rollouts together to whole episodes.

    Args:
        evidence: where they go.
        env_id: environment.
        setups: what it was made of; several in a mixture.
        layout: what the entries of a row are.
        seed: of the training run.
        lanes: environments that advance together.
    """

    def __init__(
        self,
        evidence: TrainingEvidence,
        env_id: str,
        setups: Sequence[Setup],
        layout: Layout,
        seed: int,
        lanes: int,
    ) -> None:
        packages = {**evidence.context.packages, **installed_versions(["jax"])}
        self._evidence = evidence
        self._context = replace(evidence.context, float_width=32, packages=packages)
        self._env_id = env_id
        self._setups = [(setup, 0) for setup in setups]
        self._layout = layout
        self._log = EpisodeLog(layout, [self._context], ROWS_AT_ONCE)
        self._seed = seed
        self._open = [np.zeros((len(layout), 0)) for _ in range(lanes)]
        self._opened = np.full(lanes, now())
        self._draws = np.zeros(lanes, dtype=np.int64)
        self._quiet = np.array([quiet_status(setup) for setup in setups])
        self._next_index = evidence.context.first_episode
        self._clock = now()

    def add(
        self, rows: Array, first_rows: Array, begun: Array, ended: Array, member: Array
    ) -> None:
        """Take in one rollout.

        Args:
            rows: after each step, shape (entries, steps, lanes).
            first_rows: before each step, entries as :meth:`Layout.start` gives them, else the same
                shape.
            begun: whether an episode begins with a step, shape (steps, lanes).
            ended: whether one ends with it.
            member: of ``setups``, that the episode runs on.
        """
        clock = now()
        steps, lanes = begun.shape
        taken = [np.zeros((len(self._layout), 0))]
        found: list[_Found] = []
        for lane in range(lanes):
            joined, last_of = self._joined(lane, rows, first_rows, begun, member[:, lane])
            stops = np.flatnonzero(ended[:, lane])
            ends = last_of[stops] + 1
            whole = int(ends[-1]) if len(ends) else 0
            taken.append(joined[:, :whole])
            self._open[lane] = joined[:, whole:]
            counts = np.diff(ends, prepend=0)
            found += [
                _Found(int(step), lane, int(count), int(member[step, lane]))
                for step, count in zip(stops, counts, strict=True)
            ]
        self._log_episodes(np.concatenate(taken, axis=1), found, self._clock, clock, steps)
        self._clock = clock

    def commit(self) -> Path | None:
        """Write the finished episodes; None if there are none."""
        if not len(self._log):
            return None
        table = unhashed_table(self._log, self._env_id, self._setups)
        return EvidenceStore(self._evidence.store).commit_unhashed(self._evidence.batch, table)

    def _joined(
        self, lane: int, rows: Array, first_rows: Array, begun: Array, member: Array
    ) -> tuple[Array, Array]:
        """A lane's rows, with those left over in front and a row for every reset.

        Returns:
            The rows, and the place of each step's row among them.
        """
        left = self._open[lane]
        starts = np.flatnonzero(begun[:, lane])
        places = left.shape[1] + np.arange(len(begun)) + np.cumsum(begun[:, lane])
        joined = np.zeros((len(self._layout), left.shape[1] + len(begun) + len(starts)))
        joined[:, : left.shape[1]] = left
        joined[:, places] = rows[:, :, lane]
        joined[:, places[starts] - 1] = self._layout.start_rows(
            first_rows[:, starts, lane], self._quiet[member[starts]]
        )
        return joined, places

    def _log_episodes(
        self, rows: Array, found: list[_Found], before: int, after: int, steps: int
    ) -> None:
        """Hand whole episodes to the log, numbered in the order in which they ended.

        Args:
            rows: theirs, lane by lane.
            found: the episodes, lane by lane.
            before: time at the start of the rollout, µs.
            after: time at its end, µs.
            steps: decisions of a lane in it.
        """
        order = sorted(range(len(found)), key=lambda i: (found[i].step, found[i].lane))
        index = {place: self._next_index + rank for rank, place in enumerate(order)}
        self._next_index += len(found)
        heads = []
        for place, (step, lane, _, setup) in enumerate(found):
            ended = before + (after - before) * (step + 1) // steps
            key = f"fleet-{self._seed}-{lane}/{self._draws[lane]}"
            opened = int(self._opened[lane])
            heads.append(EpisodeHead(index[place], None, key, opened, ended, setup))
            self._opened[lane] = ended
            self._draws[lane] += 1
        if heads:
            counts = np.array([episode.rows for episode in found])
            self._log.add(rows, counts, EpisodeHeads.of(heads))
