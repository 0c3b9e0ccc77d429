"""What the recorders of single and vector environments have in common."""

from __future__ import annotations

import os
import time
import weakref
from collections.abc import Callable, Mapping, Sequence
from multiprocessing.util import Finalize
from pathlib import Path
from typing import Any

import gymnasium as gym
import gymnasium.wrappers.vector
import numpy as np
import numpy.typing as npt

from integ_gym.envs.settings import Setup
from integ_gym.envs.transition import quiet_status

from ..episodes.attribution import ReplayLookups, SetupOfLane
from ..episodes.context import EpisodeContext
from ..episodes.episode_log import EpisodeLog
from ..episodes.layout import Layout
from ..episodes.table import record_table, unhashed_table
from ..store.store import EvidenceStore
from .reservation import Episodes, Reservation, batch_name

_CHANGING = (
    gym.ActionWrapper,
    gym.ObservationWrapper,
    gym.RewardWrapper,
    gym.wrappers.NormalizeReward,
    gym.vector.VectorActionWrapper,
    gym.vector.VectorObservationWrapper,
    gym.vector.VectorRewardWrapper,
    gym.wrappers.vector.NormalizeReward,
)
"""Wrappers that change actions, observations or rewards."""


class Recorder:
    """Wrapper that keeps finished episodes and commits them to a store in batches.

    It stands before Gymnasium's wrapper among the bases of a recorder.
    """

    def _prepare(
        self,
        env: Any,
        setups: list[SetupOfLane],
        store: EvidenceStore | str | Path,
        contexts: Sequence[EpisodeContext],
        episodes: Sequence[Episodes],
        commit_on_close: bool,
        commit_every: int | None,
    ) -> None:
        """Begin with nothing recorded.

        Args:
            env: the environment, single or vector.
            setups: its setups with the lane whose plant parameters hold.
            store: the store, or its directory.
            contexts: what the episodes are for; each belongs to one of them.
            episodes: that are going to be recorded of each.
            commit_on_close: whether :meth:`close` commits what has not been committed.
            commit_every: finished episodes that are committed together; None: all at the end.

        Raises:
            EvidenceError: if the episodes are recorded elsewhere, or have been.
            ValueError: for a ``commit_every`` below 1, or a directory that cannot be written to.
        """
        if commit_every is not None and commit_every < 1:
            raise ValueError(f"`commit_every` must be 1 or above, or None, got {commit_every}")
        self._store = store if isinstance(store, EvidenceStore) else EvidenceStore(store)
        self._contexts = tuple(contexts)
        self._setups = setups
        self._env_id: str = env.spec.id if env.spec else type(env.unwrapped).__name__
        self._commit_on_close = commit_on_close
        self._commit_every = commit_every if commit_on_close else None
        self._horizon = max(setup.timing.horizon for setup, _ in setups)
        self._quiet = np.array([quiet_status(setup) for setup, _ in setups])
        self._noted = False
        self._lay_out(None)
        self._reservation: Reservation | None = None
        if commit_on_close:
            self._reservation = Reservation(self._store, self._contexts, episodes)
            self._process = os.getpid()
            self._at_exit = Finalize(None, _end_of, (weakref.ref(self),), exitpriority=0)

    def __getstate__(self) -> Any:
        """Refused: what a copy and its original recorded would be mixed.

        Raises:
            TypeError: always.
        """
        raise TypeError(
            "a recorder cannot be copied or pickled; copy the environment that it records, and "
            "record the copy in a context of its own"
        )

    def __del__(self) -> None:
        """What nobody has any more is written, and others may record the same episodes."""
        if getattr(self, "_reservation", None) is not None and self._process == os.getpid():
            self._end()

    def summaries(self) -> dict[str, npt.NDArray[Any]]:
        """Summaries of the finished episodes that are not committed yet.

        Returns:
            One value per episode; see :func:`integ_gym.evidence.episodes.summary.summarise`.
        """
        self._hand_over()
        episodes = self._log.episodes()
        indices = np.array(episodes.heads.index, dtype=np.int64)
        return {"episode_index": indices, **episodes.summary}

    def take(self, replays: ReplayLookups | None = None) -> Any:
        """The finished episodes as a table, to be committed with others; None if there are none.

        Args:
            replays: see :data:`integ_gym.evidence.episodes.attribution.ReplayLookups`.
        """
        table = self._table(record_table, replays)
        self._log.clear()
        return table

    def commit(self, name: str | None = None, replays: ReplayLookups | None = None) -> Path | None:
        """Write the finished episodes as one batch; None if there are none.

        Args:
            name: name of the batch; by default made of environment, cell, policy and episodes, so
                that the same work done twice is refused.
            replays: see :data:`integ_gym.evidence.episodes.attribution.ReplayLookups`.

        Raises:
            BatchExistsError: if the batch has been committed before.
        """
        table = self._table(unhashed_table, replays)
        if table is None:
            return None
        path = self._store.commit_unhashed(name or self._batch_name(), table)
        self._log.clear()
        return path

    def close(self, **kwargs: Any) -> None:
        """Commit, if wanted, and close the environment; finished episodes can still be taken."""
        try:
            if self._commit_on_close:
                self._end()
        finally:
            super().close(**kwargs)  # type: ignore[misc]

    def _end(self) -> None:
        """Commit what is left, and let others record the same episodes."""
        try:
            self.commit()
        finally:
            if self._reservation is not None:
                self._at_exit.cancel()
                self._reservation.release()
                self._reservation = None

    def _commit_if_many(self) -> None:
        """Commit, if so many episodes have finished that they are wanted on disk."""
        if self._commit_every is not None and self._waiting_to_be_written() >= self._commit_every:
            self.commit()

    def _waiting_to_be_written(self) -> int:
        """Finished episodes that have not been committed."""
        return len(self._log)

    def _hand_over(self) -> None:
        """Give the log the finished episodes that it does not have yet."""

    def _note_contact(self, info: Mapping[str, Any]) -> bool:
        """Learn from the first reset whether there is contact; True if it is the first."""
        first = not self._noted
        if first:
            self._noted = True
            self._lay_out(info)
        return first

    def _lay_out(self, info: Mapping[str, Any] | None) -> None:
        setup = self._setups[0][0]
        self._layout = Layout(setup.plant, setup.task, info)
        self._log = EpisodeLog(self._layout, self._contexts)

    def _table(self, made: Callable[..., Any], replays: ReplayLookups | None) -> Any:
        self._hand_over()
        if not len(self._log):
            return None
        return made(self._log, self._env_id, self._setups, replays)

    def _batch_name(self) -> str:
        heads = self._log.episodes().heads
        episodes = list(zip(heads.context, heads.index, strict=True))
        return batch_name(self._env_id, self._contexts, episodes)


def _end_of(recorder: weakref.ref[Recorder]) -> None:
    """At the end of the process."""
    alive = recorder()
    if alive is not None:
        alive._end()


def is_known(env: Any, kinds: tuple[type, ...]) -> bool:
    """Whether the environment or one inside its wrappers is of these kinds."""
    while not isinstance(env, kinds):
        if env is env.unwrapped:
            return False
        env = env.env
    return True


def recorded(env: Any, kinds: tuple[type, ...], spaces: tuple[str, ...]) -> Any:
    """The environment that is recorded: the outermost of these kinds.

    Raises:
        TypeError: if there is none, or a wrapper around it changes what a policy sees.
    """
    wrapper: Any = env
    limits: list[int] = []
    while not isinstance(wrapper, kinds):
        if wrapper is env.unwrapped:
            raise TypeError(
                f"evidence is recorded of integ-gym environments, got {type(wrapper).__name__}; "
                "make one with gym.make or gym.make_vec, or give a MuJoCo task to "
                "integ_gym.rediscretize"
            )
        if isinstance(wrapper, _CHANGING):
            raise TypeError(
                f"the wrapper {type(wrapper).__name__} changes what would be recorded: put the "
                "recorder around the environment first, and the other wrappers around the recorder"
            )
        if isinstance(wrapper, gym.wrappers.TimeLimit):
            limits.append(wrapper._max_episode_steps)
        wrapper = wrapper.env
    found: Any = wrapper
    horizon = found.setup.timing.horizon
    if any(limit < horizon for limit in limits):
        raise TypeError(
            f"a TimeLimit ends episodes after {min(limits)} steps, and their records would say "
            f"{horizon}; give `max_episode_steps` or `duration` to gym.make instead"
        )
    for space in spaces:
        own, changed = getattr(wrapper, space), getattr(env, space)
        if own != changed:
            raise TypeError(
                f"a wrapper changes {space} from {own} to {changed}: put the recorder around the "
                "environment first, and the other wrappers around the recorder"
            )
    return wrapper


def all_setups(setups: Sequence[Setup], lanes: int) -> list[SetupOfLane]:
    """Setups with lanes, setup by setup; one lane is enough where all lanes are alike."""
    varied = any(isinstance(x, np.ndarray) for setup in setups for x in setup.arguments().values())
    return [(setup, lane) for setup in setups for lane in range(lanes if varied else 1)]


def now() -> int:
    """Unix time, µs."""
    return time.time_ns() // 1000
