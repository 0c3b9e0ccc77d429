"""Recording of vector environments: `RecordVectorEvidence`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv, VectorWrapper

from integ_gym.envs.lanes import DiscretizedVectorEnv
from integ_gym.envs.ops.ops import Array
from integ_gym.envs.tasks.interface import to_state_order
from integ_gym.support.errors import InputError

from .episodes import EpisodeHeads
from .labels import EpisodeContext
from .recorder import Recorder, all_setups, is_drawn, now, recorded
from .reservation import Episodes, from_on
from .store import EvidenceStore

_WIDE, _GAP = 64, 8
"""Lanes in whole multiples of the first are set apart by a gap, for a processor's cache keeps few
numbers that lie a power of two apart, as those of a lane would."""


class _Ended(NamedTuple):
    """Episodes that have ended and wait to be gathered."""

    lanes: Array
    """Where they were, shape (episodes,)."""
    ends: Array
    """Steps in the buffer when each ended, its last one included, shape (episodes,)."""
    counts: Array
    """Rows of each, its reset's included, shape (episodes,)."""
    first: Array
    """Their rows at the reset, shape (entries, episodes)."""


class LaneBuffer:
    """The last control steps of all lanes, at least one horizon of them.

    Args:
        entries: of a row.
        lanes: number of lanes.
        horizon: most control steps of an episode.

    Attributes:
        active: lanes with an episode under way that is recorded, shape (lanes,).
        episodes: that have ended and wait to be gathered.
        waiting: rows of these.
    """

    def __init__(self, entries: int, lanes: int, horizon: int) -> None:
        self.active = np.zeros(lanes, dtype=bool)
        self.episodes = self.waiting = 0
        self._ended: list[tuple[_Ended, EpisodeHeads]] = []
        self._first = np.zeros((entries, lanes))
        self._stride = lanes + (0 if lanes % _WIDE else _GAP)
        self._rows = np.zeros((entries, horizon + 64 + horizon // 2, self._stride))
        self._steps = self._rows[:, :, :lanes]
        self._starts = np.zeros(lanes, dtype=np.int64)
        self._time = 0

    @property
    def full(self) -> bool:
        """Whether there is no room for a step; gathering what waits makes some."""
        return self._time >= len(self._steps[0])

    def add(self, row: Sequence[Array]) -> None:
        """Take in a control step: every entry of its row, of shape (lanes,).

        Steps that no episode under way needs are dropped when there is no room.

        Raises:
            BufferError: if episodes wait while there is no room.
        """
        if self.full:
            if self.waiting:
                raise BufferError("episodes wait in a full buffer; gather them first")
            oldest = int(self._starts[self.active].min(initial=self._time))
            self._steps[:, : self._time - oldest] = self._steps[:, oldest : self._time]
            self._starts -= oldest
            self._time -= oldest
        for place, values in enumerate(row):
            self._steps[place, self._time] = values
        self._time += 1

    def begin(self, lanes: Array, first: Array, record: Array) -> None:
        """Begin an episode in some lanes, after the last row.

        Args:
            lanes: lane numbers.
            first: their rows at the reset, shape (entries, len(lanes)).
            record: whether each of these episodes is recorded.
        """
        if not (self.waiting or self.active.any()):
            self._time = 0
        self._first[:, lanes] = first
        self._starts[lanes] = self._time
        self.active[lanes] = record

    def end(self, lanes: Array, heads: EpisodeHeads) -> None:
        """End episodes with the last row; they wait to be gathered.

        Args:
            lanes: lane numbers, ascending.
            heads: what identifies the episodes.
        """
        self.active[lanes] = False
        counts = self._time - self._starts[lanes] + 1
        ends = np.full(len(lanes), self._time)
        self._ended.append((_Ended(lanes, ends, counts, self._first[:, lanes]), heads))
        self.episodes += len(lanes)
        self.waiting += int(counts.sum())

    def gather(self) -> tuple[Array, Array, EpisodeHeads]:
        """The episodes that wait, at least one, in the order in which they ended.

        They wait until :meth:`forget`, so that nothing is lost where gathering is interrupted.

        Returns:
            Their rows one after the other, shape (entries, sum of counts), how many each has, its
            reset's included, and what identifies them.
        """
        columns = zip(*(ended for ended, _ in self._ended), strict=True)
        ended = _Ended(*(np.concatenate(parts, axis=-1) for parts in columns))
        heads = EpisodeHeads.joined([heads for _, heads in self._ended])
        return self._rows_of(ended), ended.counts, heads

    def forget(self) -> None:
        """Drop the episodes that wait."""
        self._ended, self.episodes, self.waiting = [], 0, 0

    def _rows_of(self, ended: _Ended) -> Array:
        lanes, ends, counts, first = ended
        together = not (np.ptp(ends) or np.ptp(counts))
        if together and len(lanes) > 1 and (np.diff(lanes) == 1).all():
            return self._beside_each_other(ended)
        places, resets = self._places(ended)
        rows = np.empty((len(self._rows), len(places)))
        for entry, steps in enumerate(self._rows.reshape(len(self._rows), -1)):
            steps.take(places, out=rows[entry], mode="clip")  # unbuffered; all places are in range
        rows[:, resets] = first
        return rows

    def _places(self, ended: _Ended) -> tuple[Array, Array]:
        """Where the rows of episodes are among all steps of all lanes, and which are resets'.

        A reset's place is any.
        """
        stops = np.cumsum(ended.counts)
        last = (ended.ends - 1) * self._stride + ended.lanes
        to_go = np.repeat(stops, ended.counts) - np.arange(1, stops[-1] + 1)
        places = np.repeat(last, ended.counts) - to_go * self._stride
        resets = stops - ended.counts
        places[resets] = 0
        return places, resets

    def _beside_each_other(self, ended: _Ended) -> Array:
        """Rows of neighbouring lanes whose episodes began and ended together."""
        neighbours = slice(int(ended.lanes[0]), int(ended.lanes[-1]) + 1)
        end, count = int(ended.ends[0]), int(ended.counts[0])
        rows = np.empty((len(self._rows), len(ended.lanes), count))
        rows[:, :, 0] = ended.first
        steps = self._steps[:, end - count + 1 : end, neighbours]
        rows[:, :, 1:] = steps.transpose(0, 2, 1)
        return rows.reshape(len(rows), -1)


_ROWS_AT_ONCE = 1 << 16
"""Rows of finished episodes that are gathered together, at least, where the buffer has room."""

_SPACES = (
    "observation_space",
    "action_space",
    "single_observation_space",
    "single_action_space",
)


class RecordVectorEvidence(Recorder, VectorWrapper):
    """Records every finished episode of a testbed's vector environment.

    Spaces, spec, observations, rewards and info pass through unchanged, in all three autoreset
    modes. Finished episodes are written in batches: ``commit_every`` together, and the rest by
    :meth:`commit`, :meth:`close` or the end of the process, whichever comes first; episodes that
    are not finished are not written.

    Args:
        env: a vector environment that a testbed made, with no wrapper that changes what a policy
            sees.
        store: an :class:`EvidenceStore` or its directory.
        context: what the episodes are for; of several, each has an equal share of the lanes, in
            their order.
        episodes: for paired starts, one episode index per lane: the lane's first episode has it,
            and what the lane does after that is not recorded. By default all episodes of a context
            count up from its ``first_episode`` in the order in which they end, and by lane where
            they end together.
        commit_on_close: False: only :meth:`commit` writes.
        commit_every: finished episodes that are written together, at least; None: all at the end,
            so that ``commit(replays=…)`` can label every one.

    Raises:
        TypeError: for another environment.
        EvidenceError: if another recorder is open for the same episodes, or they are recorded.
        ValueError: if the contexts do not divide the lanes, if ``episodes`` does not have one
            index per lane, all different within a context, for a ``commit_every`` below 1, or a
            directory that cannot be written to.
    """

    def __init__(
        self,
        env: VectorEnv[Any, Any, Any],
        store: EvidenceStore | str | Path,
        context: EpisodeContext | Sequence[EpisodeContext],
        *,
        episodes: Sequence[int] | None = None,
        commit_on_close: bool = True,
        commit_every: int | None = 1000,
    ) -> None:
        super().__init__(env)
        self._inner = recorded(env, (DiscretizedVectorEnv,), _SPACES)
        self._mode: AutoresetMode = self._inner.autoreset_mode
        setups = all_setups(self._inner.setups, self.num_envs)
        self._per_member = len(setups) // len(self._inner.setups)
        contexts = [context] if isinstance(context, EpisodeContext) else list(context)
        if not contexts or self.num_envs % len(contexts):
            raise InputError(
                f"the number of contexts must divide the number of lanes ({self.num_envs}), got "
                f"{len(contexts)}"
            )
        self._share = self.num_envs // len(contexts)
        self._next_index = [context.first_episode for context in contexts]
        self._episodes = self._check_episodes(episodes)
        claims = self._claims(self._episodes)
        self._prepare(env, setups, store, contexts, claims, commit_on_close, commit_every)
        self._buffer: LaneBuffer | None = None
        self._waiting = np.zeros(self.num_envs, dtype=bool)
        self._recorded = np.zeros(self.num_envs, dtype=bool)
        self._member = np.zeros(self.num_envs, dtype=np.int64)
        self._wall_start = np.zeros(self.num_envs, dtype=np.int64)
        self._draws = np.full(self.num_envs, -1)
        self._seeds: list[int | None] = [None] * self.num_envs

    def assign(self, episodes: Sequence[int]) -> None:
        """Give every lane its next paired episode, which begins when the lane is next reset.

        Raises:
            EvidenceError: if another recorder is open for the same episodes, or they are recorded.
            ValueError: if it is not one index per lane, all different within a context.
        """
        checked = self._check_episodes(episodes)
        if self._reservation is not None:
            self._reservation.hold(self._claims(checked))
        self._episodes = checked
        self._recorded[:] = False
        if self._buffer is not None:
            self._buffer.active[:] = False

    @property
    def recorded(self) -> Array:
        """With paired starts, whether a lane's episode has ended, shape (num_envs,)."""
        return self._recorded.copy()

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Any, dict[str, Any]]:
        """Start episodes; those that have not ended in the lanes reset are forgotten."""
        mask = (options or {}).get("reset_mask")
        observation, info = self.env.reset(seed=seed, options=options)  # type: ignore[arg-type]
        if self._buffer is None:
            self._lay_out(info)
            self._buffer = LaneBuffer(len(self._layout), self.num_envs, self._horizon)
        buffer = self._buffer
        lanes = np.arange(self.num_envs) if mask is None else np.flatnonzero(mask)
        shared = isinstance(seed, (int, np.integer))
        for lane in [] if seed is None else lanes.tolist():
            given = seed + lane if shared else seed[lane]  # type: ignore[operator,index]
            if given is not None:
                self._seeds[lane] = int(given) if is_drawn(options) else None
                self._draws[lane] = -1
        self._begin(buffer, lanes, observation, info)
        self._waiting[lanes] = False
        return observation, info

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """Advance every lane by one control period."""
        result = observation, reward, terminated, truncated, info = self.env.step(actions)
        buffer = self._buffer
        if buffer is None or self._recorded.all():
            return result
        done = terminated | truncated
        same_step = self._mode is AutoresetMode.SAME_STEP
        ending, state = (reward, terminated, truncated), self._inner.state_components
        row = self._row(info, ending, state, observation)
        if same_step and done.any():
            final = observation.copy()
            final[done] = np.stack(info["final_obs"][done])
            states = to_state_order(self._inner.setups[0].task, self._inner.final_state)
            last = self._row(info["final_info"], ending, states.T, final)
            row = tuple(np.where(done, *both) for both in zip(last, row, strict=True))
        if buffer.full:
            self._hand_over()
        buffer.add(row)
        self._finish(buffer, np.flatnonzero(done & buffer.active))
        begun = np.flatnonzero(done if same_step else self._waiting)
        self._begin(buffer, begun, observation, info)
        if self._mode is AutoresetMode.NEXT_STEP:
            self._waiting = done
        return result

    def close(self, **kwargs: Any) -> None:
        """Commit, if wanted, and close the environment; finished episodes can still be taken."""
        try:
            self._hand_over()
            self._buffer = None
        finally:
            super().close(**kwargs)

    def _claims(self, episodes: list[int] | None) -> list[Episodes]:
        """Episodes that are going to be recorded of each context."""
        if episodes is None:
            return [from_on(first) for first in self._next_index]
        shares = range(0, self.num_envs, self._share)
        return [episodes[start : start + self._share] for start in shares]

    def _check_episodes(self, episodes: Sequence[int] | None) -> list[int] | None:
        if episodes is None:
            return None
        indices = [int(index) for index in episodes]
        owned = {(lane // self._share, index) for lane, index in enumerate(indices)}
        if len(indices) != self.num_envs or len(owned) != len(indices):
            raise InputError(
                f"`episodes` must be one index per lane ({self.num_envs}), all different within a "
                f"context, got {indices}"
            )
        return indices

    def _row(
        self, info: dict[str, Array], ending: tuple[Any, Any, Any], state: Any, observation: Array
    ) -> tuple[Array, ...]:
        return self._layout.row(info, self._inner.status_codes, ending, state, observation.T)

    def _begin(
        self, buffer: LaneBuffer, lanes: Array, observation: Array, info: dict[str, Any]
    ) -> None:
        if not lanes.size:
            return
        entries = self._layout.start(info, self._inner.state_components, observation.T)
        first = np.array([values[lanes] for values in entries])
        if "mixture_index" in info:
            self._member[lanes] = info["mixture_index"][lanes]
        quiet = self._quiet[self._member[lanes] * self._per_member]
        rows = self._layout.start_rows(first, quiet)
        buffer.begin(lanes, rows, ~self._recorded[lanes])
        self._wall_start[lanes] = now()
        counted = getattr(self._inner, "episodes", None)
        self._draws[lanes] = self._draws[lanes] + 1 if counted is None else counted[lanes]

    def _finish(self, buffer: LaneBuffer, lanes: Array) -> None:
        """Note the episodes that end in ``lanes``."""
        if not lanes.size:
            return
        buffer.end(lanes, self._heads_of(lanes))
        if buffer.waiting >= _ROWS_AT_ONCE:
            self._hand_over()
        self._recorded[lanes] = self._episodes is not None
        self._commit_if_many()

    def _count_waiting(self) -> int:
        return len(self._log) + (0 if self._buffer is None else self._buffer.episodes)

    def _hand_over(self) -> None:
        if self._buffer is not None and self._buffer.episodes:
            gather = self._buffer.gather()
            self._buffer.forget()
            self._log.add(*gather)

    def _heads_of(self, lanes: Array) -> EpisodeHeads:
        """What identifies the episodes that end now in ``lanes``, which ascend."""
        entropies, setups = self._inner.np_random_seed, self._member[lanes] * self._per_member
        if self._per_member > 1:
            setups += lanes
        contexts = lanes // self._share
        ended = zip(lanes.tolist(), self._draws[lanes].tolist(), strict=True)
        keys = [f"{entropies[lane]}/{draws}" for lane, draws in ended]
        return EpisodeHeads(
            index=self._indices(lanes, contexts),
            seed=[self._seeds[lane] for lane in lanes.tolist()],
            rng_key=keys,
            wall_start=self._wall_start[lanes].tolist(),
            wall_end=[now()] * len(lanes),
            setup=setups.tolist(),
            context=contexts.tolist(),
        )

    def _indices(self, lanes: Array, contexts: Array) -> list[int]:
        """Numbers of the episodes in ``lanes``, which are then taken."""
        if self._episodes is not None:
            return [self._episodes[lane] for lane in lanes.tolist()]
        indices: list[int] = []
        for context, count in enumerate(np.bincount(contexts).tolist()):
            first = self._next_index[context]
            self._next_index[context] += count
            indices += range(first, first + count)
        return indices
