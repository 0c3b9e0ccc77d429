"""Environments that pass their state from call to call, as Brax and MuJoCo Playground have them."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from gymnasium.envs.registration import EnvSpec
from numpy.typing import NDArray

from integ_gym.support.packages.extras import load


class StatePassing(gym.Env[NDArray[np.float32], NDArray[np.float32]]):
    """One of them as a Gymnasium environment, its functions compiled.

    What it calls done ends an episode; a time limit is another's business. JAX draws the starts
    from the seed alone.

    Args:
        title: what it is called.
        inner: has ``reset(key)`` and ``step(state, action)``, which return a state with ``obs``,
            ``reward`` and ``done``, and ``action_size``.
        entry: of ``obs``, where that is a mapping.
    """

    def __init__(self, title: str, inner: Any, entry: str = "state") -> None:
        self.title, self.inner, self._entry = title, inner, entry
        self.spec = EnvSpec(f"{title}-v0")
        self._jax = load("jax", "fleet")
        self._reset, self._step = _compiled(inner)
        self.action_space = spaces.Box(-1.0, 1.0, (inner.action_size,), np.float32)
        size = inner.observation_size
        shape = size[entry] if isinstance(size, dict) else size
        shape = (shape,) if isinstance(shape, int) else tuple(shape)
        self.observation_space = spaces.Box(-np.inf, np.inf, shape, np.float32)
        self._state: Any = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Start an episode."""
        super().reset(seed=seed)
        key = self._jax.random.PRNGKey(int(self.np_random.integers(2**31)))
        self._state = self._reset(key)
        return self._observation(), {}

    def step(
        self, action: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Advance one decision."""
        self._state = self._step(self._state, np.asarray(action, np.float32))
        reward, done = float(self._state.reward), bool(self._state.done)
        return self._observation(), reward, done, False, {}

    def _observation(self) -> NDArray[np.float32]:
        told = self._state.obs
        return np.array(told[self._entry] if isinstance(told, dict) else told, np.float32)


@lru_cache(maxsize=32)
def _compiled(inner: Any) -> tuple[Any, Any]:
    """Reset and step: one program each, for all lanes of a task and all of its states."""
    jax = load("jax", "fleet")

    def typed(leaf: Any) -> Any:
        """Without JAX's weak types, with which a later state would be another program's."""
        array = jax.numpy.asarray(leaf)
        return array.astype(array.dtype)

    return (
        jax.jit(lambda key: jax.tree.map(typed, inner.reset(key))),
        jax.jit(lambda state, action: jax.tree.map(typed, inner.step(state, action))),
    )


def step_told(step: Any) -> float:
    """A step that is kept in single precision, s, as the number that it was given as."""
    return float(str(np.float32(step)))
