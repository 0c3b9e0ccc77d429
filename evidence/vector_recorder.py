"""``RecordVectorEvidence``: evidence of every episode of a vector environment."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import numpy.typing as npt
from gymnasium.vector import AutoresetMode, VectorEnv, VectorWrapper

from integ_gym.envs.vector import IntegVectorEnv
from integ_gym.evidence.context import EpisodeContext
from integ_gym.evidence.episode_log import EpisodeHead
from integ_gym.evidence.fields import STATUS_CODES
from integ_gym.evidence.layout import STATUS
from integ_gym.evidence.recording import Recording, all_setups, check_unchanged, now
from integ_gym.evidence.store import EvidenceStore
from integ_gym.evidence.table import ReplayLookup

Array = npt.NDArray[Any]

_EVERYONE = slice(None)

_ENDING = ("reward", "terminated", "truncated")

_SPACES = (
    "observation_space",
    "action_space",
    "single_observation_space",
    "single_action_space",
)


class RecordVectorEvidence(VectorWrapper):
    """Records every finished episode of an integ-gym vector environment.

    Spaces, spec, observations, rewards and info pass through unchanged, in all three autoreset
    modes. Episodes are kept in memory and written as one batch by :meth:`commit` or :meth:`close`;
    episodes that are not finished are not written.

    Args:
        env: an integ-gym vector environment, with no wrapper that changes what a policy sees.
        store: an :class:`EvidenceStore` or its directory.
        context: what the episodes are for.
        episodes: for paired starts, one episode index per lane: the lane's first episode has it,
            and what the lane does after that is not recorded. By default all episodes count up
            from ``context.first_episode`` in the order in which they end, and by lane where they
            end together.
        commit_on_close: whether :meth:`close` commits what has not been committed.

    Raises:
        TypeError: for another environment.
        ValueError: if ``episodes`` does not have one index per lane, all different.
    """

    def __init__(
        self,
        env: VectorEnv[Any, Any, Any],
        store: EvidenceStore | str | Path,
        context: EpisodeContext,
        *,
        episodes: Sequence[int] | None = None,
        commit_on_close: bool = True,
    ) -> None:
        super().__init__(env)
        check_unchanged(env, IntegVectorEnv, _SPACES)
        self._inner: Any = env.unwrapped
        self._mode: AutoresetMode = self._inner.autoreset_mode
        setups = all_setups(self._inner.setups, self.num_envs)
        self._per_member = len(setups) // len(self._inner.setups)
        self._recording = Recording(env, setups, store, context)
        self._commit_on_close = commit_on_close
        self._next_index = context.first_episode
        self._episodes = self._checked(episodes)
        self._prepare_lanes()

    def assign(self, episodes: Sequence[int]) -> None:
        """Give every lane its next paired episode, which begins with the next :meth:`reset`.

        Raises:
            ValueError: if it is not one index per lane, all different.
        """
        self._episodes = self._checked(episodes)
        self._active[:] = self._ran[:] = False

    @property
    def recorded(self) -> Array:
        """With paired starts, whether a lane's episode has ended, shape (num_envs,)."""
        ran: Array = self._ran.copy()
        return ran

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Any, dict[str, Any]]:
        """Start episodes; those that have not ended in the lanes reset are forgotten."""
        mask = (options or {}).get("reset_mask")
        observation, info = self.env.reset(seed=seed, options=options)  # type: ignore[arg-type]
        if self._recording.note_contact(info) or not self._rows.size:
            self._allocate()
        lanes = np.arange(self.num_envs) if mask is None else np.flatnonzero(mask)
        for lane in lanes.tolist():
            self._note_seed(lane, _seed_of(seed, lane))
        first = np.zeros((len(self._recording.layout), self.num_envs))
        self._fill(first, observation, info, lanes)
        self._begin(lanes, first[:, lanes], info)
        self._waiting[lanes] = False
        return observation, info

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """Advance every lane by one control period."""
        result = observation, reward, terminated, truncated, info = self.env.step(actions)
        if self._ran.all():
            return result
        done = terminated | truncated
        row = self._next_row()
        self._fill(row, observation, info, _EVERYONE)
        begun = np.flatnonzero(self._begun_by_step(done))
        first = row[:, begun]
        if self._mode is AutoresetMode.SAME_STEP and begun.size:
            self._fill_final(row, info, begun)
        for name, values in zip(_ENDING, (reward, terminated, truncated), strict=True):
            row[self._recording.layout.place(name)] = values
        self._finish(np.flatnonzero(done & self._active))
        self._begin(begun, first, info)
        self._waiting = done if self._mode is AutoresetMode.NEXT_STEP else self._waiting
        return result

    def commit(self, name: str | None = None, replays: ReplayLookup | None = None) -> Path | None:
        """Write the finished episodes as one batch; None if there are none.

        Args:
            name: name of the batch; by default made of environment, cell, policy and episodes, so
                that the same work done twice is refused.
            replays: what replays said, for all episodes or by episode index.

        Raises:
            BatchExistsError: if the batch has been committed before.
        """
        return self._recording.commit(name, replays)

    def summaries(self) -> dict[str, Array]:
        """Summaries of the finished episodes that are not committed yet, by field name."""
        return self._recording.summaries()

    def close(self, **kwargs: Any) -> None:
        """Commit, if wanted, and close the environment."""
        try:
            if self._commit_on_close:
                self.commit()
        finally:
            super().close(**kwargs)

    def _checked(self, episodes: Sequence[int] | None) -> list[int] | None:
        if episodes is None:
            return None
        indices = [int(index) for index in episodes]
        if len(indices) != self.num_envs or len(set(indices)) != len(indices):
            raise ValueError(
                f"`episodes` must be one index per lane ({self.num_envs}), all different, got "
                f"{indices}"
            )
        return indices

    def _prepare_lanes(self) -> None:
        lanes = self.num_envs
        self._rows = np.zeros((0, 0, 0))
        self._time = 0
        self._starts = np.zeros(lanes, dtype=np.int64)
        self._active = np.zeros(lanes, dtype=bool)
        self._waiting = np.zeros(lanes, dtype=bool)
        self._ran = np.zeros(lanes, dtype=bool)
        self._member = np.zeros(lanes, dtype=np.int64)
        self._wall_start = np.zeros(lanes, dtype=np.int64)
        self._draws = np.full(lanes, -1)
        self._seeds: list[int | None] = [None] * lanes

    def _allocate(self) -> None:
        """``_rows`` has shape (control steps, entries, lanes), ``_first`` (entries, lanes)."""
        width, lanes = len(self._recording.layout), self.num_envs
        horizon = self._recording.horizon
        self._rows = np.zeros((horizon + 64 + horizon // 2, width, lanes))
        self._first = np.zeros((width, lanes))
        self._time = 0

    def _note_seed(self, lane: int, seed: int | None) -> None:
        if seed is not None:
            self._seeds[lane], self._draws[lane] = seed, -1

    def _begun_by_step(self, done: Array) -> Array:
        """Lanes that begin an episode in a step that ends those of ``done``."""
        if self._mode is AutoresetMode.SAME_STEP:
            return done
        return self._waiting

    def _begin(self, lanes: Array, first: Array, info: dict[str, Any]) -> None:
        """Begin episodes in ``lanes`` with the rows ``first``, shape (entries, lanes)."""
        if not lanes.size:
            return
        self._first[:, lanes] = first
        for name in _ENDING:
            self._first[self._recording.layout.place(name), lanes] = 0.0
        self._starts[lanes] = self._time
        self._wall_start[lanes] = now()
        self._draws[lanes] += 1
        self._active[lanes] = ~self._ran[lanes]
        if "mixture_index" in info:
            self._member[lanes] = info["mixture_index"][lanes]

    def _next_row(self) -> Array:
        """The row of this step; the oldest are dropped when there is no room for it."""
        if self._time == len(self._rows):
            oldest = int(self._starts[self._active].min(initial=self._time))
            self._rows[: self._time - oldest] = self._rows[oldest : self._time]
            self._starts -= oldest
            self._time -= oldest
        self._time += 1
        row: Array = self._rows[self._time - 1]
        return row

    def _fill(self, row: Array, observation: Array, info: dict[str, Any], lanes: Any) -> None:
        """Write what ``info``, the observation and the state say into some lanes of a row."""
        layout = self._recording.layout
        for place, name in enumerate(layout.info):
            row[place, lanes] = info[name][lanes]
        row[layout.place(STATUS), lanes] = _codes(info["solver_status"][lanes])
        row[layout.places(layout.sensed), lanes] = observation[lanes].T
        row[layout.places(layout.state), lanes] = self._inner.state[lanes].T

    def _fill_final(self, row: Array, info: dict[str, Any], lanes: Array) -> None:
        """Put what ``lanes`` ended with in place of what they were reset to."""
        layout = self._recording.layout
        final = info["final_info"]
        for place, name in enumerate(layout.info):
            row[place, lanes] = final[name][lanes]
        row[layout.place(STATUS), lanes] = _codes(final["solver_status"][lanes])
        row[layout.places(layout.sensed), lanes] = np.stack(info["final_obs"][lanes]).T
        row[layout.places(layout.state), lanes] = final_state(self._inner)[lanes].T

    def _finish(self, lanes: Array) -> None:
        """Hand the episodes that end in ``lanes`` to the log."""
        if not lanes.size:
            return
        ended = now()
        heads = {lane: self._head(lane, ended) for lane in lanes.tolist()}
        lanes = lanes[np.argsort(self._starts[lanes], kind="stable")]
        for together in np.split(lanes, np.flatnonzero(np.diff(self._starts[lanes])) + 1):
            rows = self._episode_rows(together)
            counts = np.full(len(together), rows.shape[1])
            self._recording.log.add(
                rows.reshape(-1, rows.shape[2]), counts, [heads[k] for k in together.tolist()]
            )
        self._active[lanes] = False
        if self._episodes is not None:
            self._ran[lanes] = True

    def _episode_rows(self, lanes: Array) -> Array:
        """Rows of episodes that began together, shape (lanes, rows, entries)."""
        start = self._starts[lanes[0]]
        rows = np.empty((len(lanes), self._time - start + 1, len(self._recording.layout)))
        rows[:, 0] = self._first[:, lanes].T
        rows[:, 1:] = self._rows[start : self._time, :, lanes].transpose(2, 0, 1)
        return rows

    def _head(self, lane: int, ended: int) -> EpisodeHead:
        if self._episodes is None:
            index, self._next_index = self._next_index, self._next_index + 1
        else:
            index = self._episodes[lane]
        setup = int(self._member[lane]) * self._per_member + (lane if self._per_member > 1 else 0)
        key = f"{self._inner.np_random_seed[lane]}/{self._draws[lane]}"
        return EpisodeHead(
            index, self._seeds[lane], key, int(self._wall_start[lane]), ended, setup
        )


def _seed_of(seed: int | Sequence[int | None] | None, lane: int) -> int | None:
    """The seed that a reset with ``seed`` gives a lane."""
    if isinstance(seed, (int, np.integer)):
        return int(seed) + lane
    given = None if seed is None else seed[lane]
    return None if given is None else int(given)


def final_state(env: Any) -> Array:
    """True states at the end of the last step, before any reset, shape (num_envs, n).

    NaN where the environment does not keep them.
    """
    kept: Array = getattr(env, "final_state", np.full(env.state.shape, np.nan))
    return kept


def _codes(status: Array) -> Array:
    """Solver status names as codes."""
    codes = np.zeros(status.shape)
    for lane in np.flatnonzero(status != "ok"):
        codes[lane] = STATUS_CODES[status[lane]]
    return codes
