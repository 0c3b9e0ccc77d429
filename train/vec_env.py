"""Gymnasium's vector environments as stable-baselines3 (SB3) wants them.

SB3 takes its own `VecEnv` only. The adapter here gives it exactly what its `DummyVecEnv` gives from
single environments, while all lanes advance together.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv, VectorWrapper
from numpy.typing import NDArray

from integ_gym.support.errors import InputError
from integ_gym.support.optional import missing_package

try:
    from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper
    from stable_baselines3.common.vec_env.base_vec_env import (
        VecEnvIndices,
        VecEnvObs,
        VecEnvStepReturn,
    )
except ModuleNotFoundError as error:
    raise missing_package(str(error.name), "train") from error

_PER_LANE = ("state", "np_random", "np_random_seed")
"""Attributes of the vector environment that hold one entry per lane."""


class Sb3VecEnv(VecEnv):
    """A Gymnasium `VectorEnv` in `AutoresetMode.SAME_STEP`, as an SB3 `VecEnv`.

    Observations, rewards (float32, as SB3 keeps them), ends and infos equal those of `DummyVecEnv`
    over single environments bit by bit. At the end of an episode the info also holds
    ``terminal_observation``, ``TimeLimit.truncated`` (truncated and not terminated, so that SB3
    bootstraps the value there) and, where the environment tells ``success``, ``is_success``, from
    which SB3 logs the success rate.

    Args:
        vector_env: `num_envs` lanes; may be wrapped, as long as its API is kept.
        info_keys: entries of the info that the lanes' dictionaries hold; None for all. Fewer are
            faster: the dictionaries are built anew every step.

    Raises:
        ValueError: for another autoreset mode.
    """

    def __init__(
        self, vector_env: VectorEnv[Any, Any, Any], info_keys: Sequence[str] | None = None
    ) -> None:
        mode = vector_env.metadata.get("autoreset_mode")
        if mode is not AutoresetMode.SAME_STEP:
            raise InputError(
                f"the vector environment must reset in the step that ends an episode, got {mode}; "
                "make it with autoreset_mode=AutoresetMode.SAME_STEP"
            )
        self.vector_env = vector_env
        self._info_keys = None if info_keys is None else frozenset(info_keys)
        self._actions: NDArray[Any] | None = None
        super().__init__(
            vector_env.num_envs,
            vector_env.single_observation_space,
            vector_env.single_action_space,
        )

    def reset(self) -> VecEnvObs:
        """Start an episode in every lane, with the seeds and options set since the last reset.

        Returns:
            Observations, float32, shape (num_envs, obs_dim), in the environment's units.

        Raises:
            ValueError: if the lanes were given options that differ in more than ``state``.
        """
        options = _joint_options(self._options)
        observations, info = self.vector_env.reset(seed=self._seeds, options=options)  # type: ignore[arg-type]
        self.reset_infos = self._lane_infos(info)
        self._reset_seeds()
        self._reset_options()
        return np.asarray(observations)

    def step_async(self, actions: NDArray[Any]) -> None:
        """Take actions, shape (num_envs, …), for the next `step_wait`."""
        self._actions = actions

    def step_wait(self) -> VecEnvStepReturn:
        """Advance every lane by one control period.

        Returns:
            Observations (num_envs, obs_dim) float32, rewards (num_envs,) float32, whether each
            episode ended (num_envs,) bool, and one info per lane. A lane that ended already shows
            the first observation of its next episode.
        """
        observations, rewards, terminated, truncated, info = self.vector_env.step(self._actions)
        done = np.logical_or(terminated, truncated)
        infos = self._lane_infos(info)
        if done.any():
            finals = self._lane_infos(info["final_info"])
            for lane in np.flatnonzero(done):
                self.reset_infos[lane], infos[lane] = infos[lane], finals[lane]
                infos[lane]["terminal_observation"] = info["final_obs"][lane]
                if "success" in infos[lane]:
                    infos[lane]["is_success"] = infos[lane]["success"]
        time_limit = np.logical_and(truncated, np.logical_not(terminated)).tolist()
        for lane_info, limited in zip(infos, time_limit, strict=True):
            lane_info["TimeLimit.truncated"] = limited
        return observations, np.asarray(rewards, dtype=np.float32), done, infos

    def close(self) -> None:
        """Close the vector environment."""
        self.vector_env.close()

    def get_images(self) -> Sequence[NDArray[np.uint8] | None]:
        """One RGB frame per lane, each of shape (height, width, 3)."""
        frames: Any = self.vector_env.render()
        return [None] * self.num_envs if frames is None else list(frames)

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """An attribute of the environment, once per lane asked for.

        `state`, `np_random` and `np_random_seed` are the lane's own, `action_space` and
        `observation_space` are those of one lane, and anything else is shared by all lanes.

        Raises:
            AttributeError: if there is no such attribute.
        """
        lanes = list(self._get_indices(indices))
        if attr_name in ("action_space", "observation_space"):
            attr_name = f"single_{attr_name}"
        value = self._attribute(attr_name)
        return [value[lane] if attr_name in _PER_LANE else value for lane in lanes]

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        """Set an attribute that all lanes share.

        Raises:
            ValueError: if only some lanes are given, because lanes are no objects of their own.
            AttributeError: if the attribute cannot be set.
        """
        if sorted(self._get_indices(indices)) != list(range(self.num_envs)):
            raise InputError(
                f"the lanes share {attr_name!r}, so it cannot be set in {indices} alone; leave "
                "`indices` out, or make the environment with one value per lane"
            )
        setattr(self.vector_env.unwrapped, attr_name, value)

    def env_method(
        self,
        method_name: str,
        *method_args: Any,
        indices: VecEnvIndices = None,
        **method_kwargs: Any,
    ) -> list[Any]:
        """Refused, except for `render`: lanes are no objects of their own.

        Raises:
            NotImplementedError: with what to call instead.
        """
        if method_name == "render":
            frames = self.get_images()
            return [frames[lane] for lane in self._get_indices(indices)]
        raise NotImplementedError(
            f"the lanes advance together and have no method {method_name!r} of their own; call "
            f"vector_env.{method_name}(...) for all of them"
        )

    def env_is_wrapped(
        self, wrapper_class: type[gym.Wrapper[Any, Any, Any, Any]], indices: VecEnvIndices = None
    ) -> list[bool]:
        """Whether the vector environment is wrapped by that class, once per lane asked for."""
        wrapped = any(isinstance(layer, wrapper_class) for layer in _layers(self.vector_env))
        return [wrapped for _ in self._get_indices(indices)]

    def _attribute(self, name: str) -> Any:
        """The attribute of the outermost layer that has it."""
        for layer in _layers(self.vector_env):
            if hasattr(layer, name):
                return getattr(layer, name)
        raise AttributeError(f"{type(self.vector_env.unwrapped).__name__} has no {name!r}")

    def _lane_infos(self, info: dict[str, Any]) -> list[dict[str, Any]]:
        """One dictionary per lane, of Python values, from a vector info."""
        names = [
            name
            for name in info
            if f"_{name}" in info
            and name not in ("final_obs", "final_info")
            and (self._info_keys is None or name in self._info_keys)
        ]
        if not names:
            return [{} for _ in range(self.num_envs)]
        columns = [_plain_list(info[name]) for name in names]
        return [dict(zip(names, row, strict=True)) for row in zip(*columns, strict=True)]


class ScaledRewards(VecEnvWrapper):
    """Multiplies rewards by a constant, outside what monitors and evidence see.

    Args:
        venv: where the rewards come from.
        scale: factor, above 0.
    """

    def __init__(self, venv: VecEnv, scale: float) -> None:
        super().__init__(venv)
        self.scale = np.float32(scale)

    def reset(self) -> VecEnvObs:
        """As the wrapped environment."""
        return self.venv.reset()

    def step_wait(self) -> VecEnvStepReturn:
        """As the wrapped environment, with scaled rewards, float32 of shape (num_envs,)."""
        observations, rewards, done, infos = self.venv.step_wait()
        return observations, rewards * self.scale, done, infos


def _layers(vector_env: VectorEnv[Any, Any, Any]) -> Iterable[VectorEnv[Any, Any, Any]]:
    """The vector environment and all that it wraps, outermost first."""
    yield vector_env
    while isinstance(vector_env, VectorWrapper):
        vector_env = vector_env.env
        yield vector_env


def _plain_list(values: Any) -> list[Any]:
    """One Python value per lane."""
    return values.tolist() if isinstance(values, np.ndarray) else list(values)


def _joint_options(lanes: Sequence[dict[str, Any]]) -> dict[str, Any] | None:
    """The reset options of single lanes as those of the vector environment."""
    first = lanes[0]
    names = set(first)
    shared = {name: value for name, value in first.items() if name != "state"}
    for lane in lanes:
        if set(lane) != names or any(lane[name] != value for name, value in shared.items()):
            raise InputError(
                "all lanes reset with the same options, `state` excepted, got "
                f"{first} and {lane}; give one dictionary for all"
            )
    if "state" in names:
        shared["state"] = np.array([lane["state"] for lane in lanes], dtype=np.float64)
    return shared or None
