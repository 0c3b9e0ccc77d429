"""``RecordEvidence``: evidence of every episode of a single environment."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.envs.registration import EnvSpec

from integ_gym.envs.environment import IntegEnv
from integ_gym.envs.rediscretized import RediscretizedEnv

from ..episodes.context import EpisodeContext
from ..episodes.episode_log import EpisodeHead, EpisodeHeads
from ..store.store import EvidenceStore
from .recording import Recorder, is_known, now, recorded
from .reservation import from_on
from .stranger import Stranger

_KINDS = (IntegEnv, RediscretizedEnv)

_FEWEST_ROWS = 4096
"""So many rows of finished episodes are given to the log together, at least."""


class RecordEvidence(Recorder, gym.Wrapper[Any, Any, Any, Any]):
    """Records every finished episode of an environment.

    Of one that is not integ-gym's, what it does not tell, such as its integrator and its energy, is
    null, and the wrappers around it are listed in ``engine_description``.

    Spaces, spec, observations, rewards and info pass through unchanged. Finished episodes are
    written in batches: ``commit_every`` together, and the rest by :meth:`commit`, :meth:`close` or
    the end of the process, whichever comes first; an episode that is not finished is not written.
    Episodes count up from ``context.first_episode``.

    Args:
        env: an integ-gym environment or a rediscretized one, with no wrapper that changes what a
            policy sees; or any other of Gymnasium's interface, as the policy sees it.
        store: an :class:`EvidenceStore` or its directory.
        context: what the episodes are for.
        commit_on_close: whether anything is written but by :meth:`commit`.
        commit_every: finished episodes that are written together; None: all at the end, which
            ``commit(replays=…)`` needs that is to label them all.

    Raises:
        TypeError: for an integ-gym environment in a wrapper that changes what is seen of it.
        EvidenceError: if another recorder is open for the same episodes, or they are recorded.
        ValueError: for a ``commit_every`` below 1, or a directory that cannot be written to.
    """

    def __init__(
        self,
        env: gym.Env[Any, Any],
        store: EvidenceStore | str | Path,
        context: EpisodeContext,
        *,
        commit_on_close: bool = True,
        commit_every: int | None = 100,
    ) -> None:
        super().__init__(env)
        spaces = ("observation_space", "action_space")
        self._stranger = None if is_known(env, _KINDS) else Stranger(env)
        self._inner = self._stranger or recorded(env, _KINDS, spaces)
        self._prepare(
            env, [(self._inner.setup, 0)], store, [context], [from_on(context.first_episode)],
            commit_on_close, commit_every,
        )  # fmt: skip
        self._next_index = context.first_episode
        self._seed: int | None = None
        self._draws = -1
        self._active = False
        self._heads: list[EpisodeHead] = []
        self._counts: list[int] = []
        self._rows: list[bytes] = []
        self._finished = 0

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Start an episode; one that has not ended is forgotten."""
        observation, info = self.env.reset(seed=seed, options=options)
        if seed is not None:
            self._seed, self._draws = seed, -1
        self._draws = getattr(self._inner, "episode", self._draws + 1)
        told = info if self._stranger is None else self._stranger.told()
        if self._note_contact(told):
            self._pack = struct.Struct(f"{len(self._layout)}d").pack
        del self._rows[self._finished :]
        self._wall_start = now()
        self._active = True
        self._write(observation, (0.0, False, False), told)
        return observation, info

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Advance one control period."""
        result = observation, reward, terminated, truncated, info = self.env.step(action)
        if self._active:
            told = info if self._stranger is None else self._stranger.told(action)
            self._write(observation, (reward, terminated, truncated), told)
            if terminated or truncated:
                self._finish()
        return result

    @property
    def spec(self) -> EnvSpec | None:  # type: ignore[override]
        """The environment's own: recording is no part of it."""
        return self.env.spec

    def _write(
        self, observation: Any, ending: tuple[Any, bool, bool], info: dict[str, Any]
    ) -> None:
        inner, stranger = self._inner, self._stranger
        sensed = observation.tolist() if stranger is None else stranger.sensed(observation)
        row = self._layout.row(info, inner.status_code, ending, inner.state_components, sensed)
        self._rows.append(self._pack(*row))

    def _finish(self) -> None:
        self._active = False
        key = f"{self._inner.np_random_seed}/{self._draws}"
        head = EpisodeHead(self._next_index, self._seed, key, self._wall_start, now())
        self._heads.append(head)
        self._counts.append(len(self._rows) - self._finished)
        self._finished = len(self._rows)
        self._next_index += 1
        if self._finished >= _FEWEST_ROWS:
            self._hand_over()
        self._commit_if_many()

    def _waiting_to_be_written(self) -> int:
        return len(self._log) + len(self._heads)

    def _hand_over(self) -> None:
        if self._heads:
            rows = np.frombuffer(b"".join(self._rows[: self._finished]))
            by_entry = np.ascontiguousarray(rows.reshape(-1, len(self._layout)).T)
            heads = EpisodeHeads.of(self._heads)
            self._log.add(by_entry, np.array(self._counts, dtype=np.int64), heads)
        del self._rows[: self._finished]
        self._finished, self._heads, self._counts = 0, [], []
