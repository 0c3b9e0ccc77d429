"""What the recorders of single and vector environments have in common."""

from __future__ import annotations

import hashlib
import re
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import gymnasium as gym
import gymnasium.wrappers.vector
import numpy as np
import numpy.typing as npt

from integ_gym.envs.settings import Setup
from integ_gym.evidence.context import EpisodeContext
from integ_gym.evidence.episode_log import EpisodeLog
from integ_gym.evidence.layout import Layout
from integ_gym.evidence.store import EvidenceStore
from integ_gym.evidence.table import ReplayLookups, SetupOfLane, record_table

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


class Recording:
    """Finished episodes of one environment, committed to a store in batches.

    Args:
        env: the environment, single or vector.
        setups: its setups with the lane whose plant parameters hold.
        store: the store, or its directory.
        contexts: what the episodes are for; each belongs to one of them.

    Raises:
        TypeError: for an environment that is not ours, or whose observations a wrapper changes.
    """

    def __init__(
        self,
        env: Any,
        setups: list[SetupOfLane],
        store: EvidenceStore | str | Path,
        contexts: Sequence[EpisodeContext],
    ) -> None:
        self.store = store if isinstance(store, EvidenceStore) else EvidenceStore(store)
        self.contexts = tuple(contexts)
        self.setups = setups
        self.env_id: str = env.spec.id if env.spec else type(env.unwrapped).__name__
        setup = setups[0][0]
        self.layout = Layout(setup.plant, setup.task)
        self.log = EpisodeLog(self.layout, self.contexts)
        self._noted = False
        self.horizon = max(s.timing.horizon for s, _ in setups)

    def note_contact(self, info: Mapping[str, Any]) -> bool:
        """Learn from the first reset whether there is contact; True if rows are now others."""
        if self._noted:
            return False
        self._noted = True
        before, setup = self.layout.names, self.setups[0][0]
        self.layout = Layout(setup.plant, setup.task, info)
        self.log = EpisodeLog(self.layout, self.contexts)
        return self.layout.names != before

    def summaries(self) -> dict[str, npt.NDArray[Any]]:
        """Summaries of the finished episodes that are not committed yet, by field name."""
        episodes = self.log.episodes()
        indices = np.array([head.index for head in episodes.heads], dtype=np.int64)
        return {"episode_index": indices, **episodes.summary}

    def take(self, replays: ReplayLookups | None = None) -> Any:
        """The finished episodes as a table, to be committed with others; None if there are none.

        Args:
            replays: see :data:`integ_gym.evidence.table.ReplayLookups`.
        """
        if not len(self.log):
            return None
        table = record_table(self.log, self.env_id, self.setups, replays)
        self.log.clear()
        return table

    def commit(self, name: str | None = None, replays: ReplayLookups | None = None) -> Path | None:
        """Write the finished episodes as one batch; None if there are none.

        Args:
            name: name of the batch; by default made of environment, cell, policy and episodes, so
                that the same work done twice is refused.
            replays: see :data:`integ_gym.evidence.table.ReplayLookups`.

        Raises:
            BatchExistsError: if the batch has been committed before.
        """
        if not len(self.log):
            return None
        table = record_table(self.log, self.env_id, self.setups, replays)
        path = self.store.commit(name or self._batch_name(), table)
        self.log.clear()
        return path

    def _batch_name(self) -> str:
        indices = [head.index for head in self.log.episodes().heads]
        identity = repr([(c.cell, c.policy_id, c.policy_hash) for c in self.contexts])
        digest = hashlib.sha256(identity.encode()).hexdigest()[:16]
        stem = re.sub(r"[^A-Za-z0-9.]+", "-", self.env_id).strip(".-")[:80] or "records"
        return f"{stem}-{digest}-{min(indices):07d}-{max(indices):07d}"


def recorded(env: Any, kinds: tuple[type, ...], spaces: tuple[str, ...]) -> Any:
    """The environment that is recorded: the outermost of these kinds.

    Raises:
        TypeError: if there is none, or a wrapper around it changes what a policy sees.
    """
    wrapper = env
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
        wrapper = wrapper.env
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
