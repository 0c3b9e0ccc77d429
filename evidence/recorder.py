"""Recording of single environments: `RecordEvidence`."""

from __future__ import annotations

import json
import os
import struct
import time
import weakref
from collections.abc import Callable, Mapping, Sequence
from math import nan, prod
from multiprocessing.util import Finalize
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import gymnasium as gym
import gymnasium.wrappers.vector
import numpy as np
import numpy.typing as npt
from gymnasium.envs.registration import EnvSpec

from integ_gym.envs.environment import IntegEnv
from integ_gym.envs.foreign import ForeignPlant, ForeignTask, time_limit, wrappers_of
from integ_gym.envs.rediscretized import RediscretizedEnv
from integ_gym.envs.settings import NO_LIMIT, Setup
from integ_gym.envs.transition import quiet_status
from integ_gym.support.errors import InputError, InputTypeError

from .episodes import EpisodeHeads, EpisodeLog, Layout
from .hashing import with_hashes
from .labels import EpisodeContext
from .reservation import Episodes, Reservation, batch_name, from_on
from .store import EvidenceStore
from .table import ReplayLookups, SetupOfLane, build_unhashed_table

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
            raise InputError(f"`commit_every` must be 1 or above, or None, got {commit_every}")
        self._store = store if isinstance(store, EvidenceStore) else EvidenceStore(store)
        self._contexts = tuple(contexts)
        self._setups = setups
        self._env_id: str = env.spec.id if env.spec else type(env.unwrapped).__name__
        self._commit_on_close = commit_on_close
        self._commit_every = commit_every if commit_on_close else None
        self._horizon = max(setup.timing.horizon for setup, _ in setups)
        if self._horizon >= NO_LIMIT:
            raise InputError(
                "episodes without a limit have no records; leave `max_episode_steps` out"
            )
        self._quiet = np.array([quiet_status(setup) for setup, _ in setups])
        self._lay_out()
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
        raise InputTypeError(
            "a recorder cannot be copied or pickled; copy the environment that it records, and "
            "record the copy in a context of its own"
        )

    def __del__(self) -> None:
        """Write what is no longer in use, and let others record the same episodes."""
        if getattr(self, "_reservation", None) is not None and self._process == os.getpid():
            self._end()

    def summaries(self) -> dict[str, npt.NDArray[Any]]:
        """Summaries of the finished episodes that are not committed yet.

        Returns:
            One value per episode; see :func:`integ_gym.evidence.episodes.summarise`.
        """
        self._hand_over()
        episodes = self._log.episodes()
        indices = np.array(episodes.heads.index, dtype=np.int64)
        return {"episode_index": indices, **episodes.summary}

    def take(self, replays: ReplayLookups | None = None) -> Any:
        """The finished episodes as a table, to be committed with others; None if there are none.

        Args:
            replays: see :data:`integ_gym.evidence.table.ReplayLookups`.
        """
        table = self._build_table(replays)
        self._log.clear()
        return None if table is None else with_hashes(table)

    def commit(self, name: str | None = None, replays: ReplayLookups | None = None) -> Path | None:
        """Write the finished episodes as one batch; None if there are none.

        Args:
            name: name of the batch; by default made of environment, cell, policy and episodes, so
                that the same work done twice is refused.
            replays: see :data:`integ_gym.evidence.table.ReplayLookups`.

        Raises:
            BatchExistsError: if the batch has been committed before.
        """
        table = self._build_table(replays)
        if table is None:
            return None
        heads = self._log.episodes().heads
        episodes = list(zip(heads.context, heads.index, strict=True))
        name = name or batch_name(self._env_id, self._contexts, episodes)
        path = self._store.commit_unhashed(name, table)
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
        if self._commit_every is not None and self._count_waiting() >= self._commit_every:
            self.commit()

    def _count_waiting(self) -> int:
        """Finished episodes that have not been committed."""
        return len(self._log)

    def _hand_over(self) -> None:
        """Give the log the finished episodes that it does not have yet."""

    def _lay_out(self, info: Mapping[str, Any] | None = None) -> None:
        """Begin a log; what a reset gives as ``info`` tells whether there is contact."""
        setup = self._setups[0][0]
        self._layout = Layout(setup.plant, setup.task, info)
        self._log = EpisodeLog(self._layout, self._contexts)

    def _build_table(self, replays: ReplayLookups | None) -> Any:
        """The finished episodes as a table without hashes; None if there are none."""
        self._hand_over()
        if not len(self._log):
            return None
        return build_unhashed_table(self._log, self._env_id, self._setups, replays)


def _end_of(recorder: weakref.ref[Recorder]) -> None:
    """At the end of the process."""
    alive = recorder()
    if alive is not None:
        alive._end()


def recorded(env: Any, kinds: tuple[type, ...], spaces: tuple[str, ...]) -> Any:
    """The environment that is recorded: the outermost of these kinds.

    Raises:
        TypeError: if there is none, or a wrapper around it changes what a policy sees.
    """
    wrapper: Any = env
    limits: list[int] = []
    while not isinstance(wrapper, kinds):
        if wrapper is env.unwrapped:
            raise InputTypeError(
                f"evidence is recorded of integ-gym environments, got {type(wrapper).__name__}; "
                "make one with gym.make or gym.make_vec, or give a MuJoCo task to "
                "integ_gym.rediscretize"
            )
        if isinstance(wrapper, _CHANGING):
            raise InputTypeError(
                f"the wrapper {type(wrapper).__name__} changes what would be recorded: put the "
                "recorder around the environment first, and the other wrappers around the recorder"
            )
        if isinstance(wrapper, gym.wrappers.TimeLimit):
            limits.append(wrapper._max_episode_steps)
        wrapper = wrapper.env
    found: Any = wrapper
    horizon = max(setup.timing.horizon for setup in _setups(found))
    if any(limit < horizon for limit in limits):
        raise InputTypeError(
            f"a TimeLimit ends episodes after {min(limits)} steps, and their records would say "
            f"{horizon}; give `max_episode_steps` or `duration` to gym.make instead"
        )
    for space in spaces:
        own, changed = getattr(wrapper, space), getattr(env, space)
        if own != changed:
            raise InputTypeError(
                f"a wrapper changes {space} from {own} to {changed}: put the recorder around the "
                "environment first, and the other wrappers around the recorder"
            )
    return wrapper


def _setups(env: Any) -> Sequence[Any]:
    """What the episodes of an environment run on: of a mixture, each member."""
    mixture = getattr(env, "mixture", None)
    return (env.setup,) if mixture is None else mixture.setups


def all_setups(setups: Sequence[Setup], lanes: int) -> list[SetupOfLane]:
    """Setups with lanes, setup by setup; one lane is enough where all lanes are alike."""
    varied = any(isinstance(x, np.ndarray) for setup in setups for x in setup.arguments().values())
    return [(setup, lane) for setup in setups for lane in range(lanes if varied else 1)]


def is_drawn(options: Mapping[str, Any] | None) -> bool:
    """Whether a reset with these options draws its start by the seed alone."""
    return not {*(options or {})} - {"episode", "mixture_index", "reset_mask"}


def now() -> int:
    """Unix time, µs."""
    return time.time_ns() // 1000


MOST_NUMBERS = 512
"""An observation or action of more numbers, such as an image, is left out of the trace."""

_HORIZON = 1000
"""Steps of an episode where no limit is stated; a guess at memory alone."""

_UNKNOWN_INFO = dict.fromkeys(
    (
        *("time", "energy", "sensor_time", "actuator_work", "dissipated", "clip_loss"),
        *("energy_residual", "solver_iterations", "saturated", "fallback_used", "success"),
    ),
    nan,
)
"""What our environments put into `info`."""

_UNKNOWN_SETTINGS = (
    *("engine", "integrator", "observation_noise", "duration", "fallback", "max_speed", "start"),
)


class GenericEnv:
    """Stands where one of our environments would, for another that is recorded.

    Args:
        env: as the policy sees it, wrappers included.

    Attributes:
        setup: what a record says of it: what :mod:`integ_gym.evidence.fields` asks of a setup,
            unknown but for wrappers and constructor arguments.
        state_components: nothing: its state is not known.
        status_code: the solver's, which is not reported.
    """

    state_components: tuple[float, ...] = ()
    status_code = -1

    def __init__(self, env: gym.Env[Any, Any]) -> None:
        self._env = env
        self._observed = _count_recorded(env.observation_space)
        actions = [f"action{k}" for k in range(_count_recorded(env.action_space))]
        self._asked = [f"{name}_commanded" for name in actions]
        applied = [f"{name}_applied" for name in actions]
        unknown = dict.fromkeys((*self._asked, *applied), nan)
        self._no_action = {**_UNKNOWN_INFO, **unknown, "goal_since": -1.0}
        given = dict(env.spec.kwargs) if env.spec else {}
        observations = tuple(f"obs{k}" for k in range(self._observed))
        self.setup: Any = SimpleNamespace(
            settings=SimpleNamespace(**dict.fromkeys(_UNKNOWN_SETTINGS)),
            timing=SimpleNamespace(
                **dict.fromkeys(("dt", "control_period", "substeps")),
                horizon=time_limit(env) or _HORIZON,
                known=False,
            ),
            plant=ForeignPlant(
                type(env.unwrapped).__name__, tuple((name, "") for name in actions), frame=""
            ),
            task=ForeignTask(
                "not known: the environment does not say what success is",
                observations,
                ("",) * len(observations),
            ),
            engine=SimpleNamespace(
                version=None, width=None, reports=False, solver=dict, describe=self._describe
            ),
            arguments=lambda: {name: _plain(value) for name, value in sorted(given.items())},
            units=lambda: dict.fromkeys(given, ""),
        )

    @property
    def np_random_seed(self) -> int | None:
        """What seeded its generator; None where it does not tell."""
        return self._env.unwrapped.np_random_seed

    def info(self, action: Any = None) -> dict[str, Any]:
        """Stands in for the `info` of one of our environments."""
        if action is None or not self._asked:
            return self._no_action
        asked = zip(self._asked, _to_numbers(self._env.action_space, action), strict=True)
        return self._no_action | dict(asked)

    def sensed(self, observation: Any) -> list[float]:
        """The observation as numbers; none where there are too many."""
        return _to_numbers(self._env.observation_space, observation) if self._observed else []

    def _describe(self) -> Mapping[str, Any]:
        """What a record says of the engine: wrappers, the outermost first, and spaces."""
        env = self._env
        spaces = {"observation": env.observation_space, "action": env.action_space}
        return {
            "known": False,
            "unknown": "engine, integrator, steps, state, energy and success",
            "wrappers": [type(one).__name__ for one in wrappers_of(env)],
            "left_out": [
                f"{name} ({_count(space)} numbers)"
                for name, space in spaces.items()
                if not _count_recorded(space)
            ],
            **{f"{name}_space": _describe_space(space) for name, space in spaces.items()},
        }


def _describe_space(space: gym.Space[Any]) -> dict[str, Any]:
    """A space, of which boxes and discrete sets can be made again."""
    kind = {"kind": type(space).__name__}
    if isinstance(space, gym.spaces.Discrete):
        return {**kind, "n": int(space.n), "start": int(space.start)}
    if not isinstance(space, gym.spaces.Box):
        return kind
    return {**kind, "shape": list(space.shape), "dtype": str(space.dtype)}


def _to_numbers(space: gym.Space[Any], value: Any) -> list[float]:
    """A value of a space as numbers."""
    if isinstance(space, gym.spaces.Discrete):
        return [float(np.asarray(value).item())]
    flat: Any = gym.spaces.flatten(space, value)
    numbers: list[float] = np.ravel(flat).astype(np.float64).tolist()
    return numbers


def _count_recorded(space: gym.Space[Any]) -> int:
    """Numbers of a space's values that a trace keeps."""
    count = _count(space)
    return count if count is not None and count <= MOST_NUMBERS else 0


def _count(space: gym.Space[Any]) -> int | None:
    if isinstance(space, gym.spaces.Discrete):
        return 1
    if isinstance(space, gym.spaces.Box):
        return prod(space.shape)
    try:
        return gym.spaces.flatdim(space) if space.is_np_flattenable else None
    except (NotImplementedError, ValueError):
        return None


def _plain(value: Any) -> Any:
    """A value that JSON can hold; of another, how Python prints it."""
    try:
        json.dumps(value, allow_nan=False)
    except (TypeError, ValueError):
        return repr(value)
    return value


_KINDS = (IntegEnv, RediscretizedEnv)

_FEWEST_ROWS = 4096
"""So many rows of finished episodes are given to the log together, at least."""


class RecordEvidence(Recorder, gym.Wrapper[Any, Any, Any, Any]):
    """Records every finished episode of an environment.

    Of an environment that is not integ-gym's, what is unknown, such as integrator and energy, is
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
        commit_on_close: False: only :meth:`commit` writes.
        commit_every: finished episodes that are written together; None: all at the end, so that
            ``commit(replays=…)`` can label every one.

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
        inner: Any = env
        while not isinstance(inner, _KINDS) and inner is not inner.unwrapped:
            inner = inner.env
        known = isinstance(inner, _KINDS)
        self._generic = None if known else GenericEnv(env)
        spaces = ("observation_space", "action_space")
        self._inner = self._generic or recorded(env, _KINDS, spaces)
        setups, claims = all_setups(_setups(self._inner), 1), [from_on(context.first_episode)]
        self._prepare(env, setups, store, [context], claims, commit_on_close, commit_every)
        self._next_index = context.first_episode
        self._seed: int | None = None
        self._draws = -1
        self._active = False
        self._pack: Callable[..., bytes] | None = None
        self._heads: list[EpisodeHeads] = []
        self._counts: list[int] = []
        self._rows: list[bytes] = []
        self._finished = 0

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Start an episode; one that has not ended is forgotten."""
        observation, info = self.env.reset(seed=seed, options=options)
        if seed is not None:
            self._seed, self._draws = (seed if is_drawn(options) else None), -1
        self._draws = getattr(self._inner, "episode", self._draws + 1)
        self._member = int(info.get("mixture_index", 0)) if self._generic is None else 0
        entries = info if self._generic is None else self._generic.info()
        if self._pack is None:
            self._lay_out(entries)
            self._pack = struct.Struct(f"{len(self._layout)}d").pack
        del self._rows[self._finished :]
        self._wall_start = now()
        self._active = True
        self._write(observation, (0.0, False, False), entries)
        return observation, info

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Advance one control period."""
        result = observation, reward, terminated, truncated, info = self.env.step(action)
        if self._active:
            entries = info if self._generic is None else self._generic.info(action)
            self._write(observation, (reward, terminated, truncated), entries)
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
        inner, generic = self._inner, self._generic
        sensed = observation.tolist() if generic is None else generic.sensed(observation)
        row = self._layout.row(info, inner.status_code, ending, inner.state_components, sensed)
        self._rows.append(self._pack(*row))  # type: ignore[misc]

    def _finish(self) -> None:
        self._active = False
        key = f"{self._inner.np_random_seed}/{self._draws}"
        head = self._next_index, self._seed, key, self._wall_start, now(), self._member, 0
        self._heads.append(EpisodeHeads.of_one(*head))
        self._counts.append(len(self._rows) - self._finished)
        self._finished = len(self._rows)
        self._next_index += 1
        if self._finished >= _FEWEST_ROWS:
            self._hand_over()
        self._commit_if_many()

    def _count_waiting(self) -> int:
        return len(self._log) + len(self._heads)

    def _hand_over(self) -> None:
        if self._heads:
            rows = np.frombuffer(b"".join(self._rows[: self._finished]))
            by_entry = np.ascontiguousarray(rows.reshape(-1, len(self._layout)).T)
            heads = EpisodeHeads.joined(self._heads)
            self._log.add(by_entry, np.array(self._counts, dtype=np.int64), heads)
        del self._rows[: self._finished]
        self._finished, self._heads, self._counts = 0, [], []
