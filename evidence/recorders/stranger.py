"""An environment of which no more is known than Gymnasium asks: what a recorder is told of it.

What it does not tell (engine, integrator, steps, state, energy, success) is null in its records,
and said to be unknown; nothing is guessed.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from math import nan, prod
from types import SimpleNamespace
from typing import Any

import gymnasium as gym
import numpy as np

from integ_gym.envs.foreign import time_limit

MOST_NUMBERS = 512
"""An observation or action of more numbers, such as an image, is left out of the trace."""

_HORIZON = 1000
"""Steps of an episode where no limit is stated; a guess at memory alone."""

_NO_GOAL = "not known: the environment does not say what success is"

_UNTOLD = dict.fromkeys(
    (
        *("time", "energy", "sensor_time", "actuator_work", "dissipated", "clip_loss"),
        *("energy_residual", "solver_iterations", "saturated", "fallback_used", "success"),
    ),
    nan,
)
"""What our environments put into `info`."""


class Stranger:
    """The seat of one of our environments, taken by another.

    Args:
        env: as the policy sees it, wrappers included.

    Attributes:
        setup: what a record says of it.
        state_components: nothing: its state is not known.
        status_code: the solver's, which is not reported.
    """

    state_components: tuple[float, ...] = ()
    status_code = -1

    def __init__(self, env: gym.Env[Any, Any]) -> None:
        self._env = env
        self._observation = _size(env.observation_space)
        self._action = _size(env.action_space)
        controls = tuple((f"action{k}", "") for k in range(self._action))
        names = tuple(f"obs{k}" for k in range(self._observation))
        self._no_action = _UNTOLD | {f"{name}_{of}": nan for name, _ in controls for of in _OF}
        self._asked = [f"{name}_commanded" for name, _ in controls]
        self.setup: Any = _Setup(env, controls, names)

    @property
    def np_random_seed(self) -> int | None:
        """What seeded its generator; None where it does not tell."""
        return self._env.unwrapped.np_random_seed

    def told(self, action: Any = None) -> dict[str, Any]:
        """Stands in for the `info` of one of our environments."""
        if action is None or not self._asked:
            return {**self._no_action, "goal_since": -1.0}
        asked = dict(zip(self._asked, _numbers(self._env.action_space, action), strict=True))
        return {**self._no_action, "goal_since": -1.0, **asked}

    def sensed(self, observation: Any) -> list[float]:
        """The observation as numbers; none where there are too many."""
        return _numbers(self._env.observation_space, observation) if self._observation else []


_OF = ("commanded", "applied")


class _Setup:
    """What :mod:`integ_gym.evidence.schema.fields` asks of a setup, unknown but for wrappers."""

    def __init__(
        self, env: gym.Env[Any, Any], controls: tuple[tuple[str, str], ...], names: tuple[str, ...]
    ) -> None:
        spec = env.spec
        self._given = dict(spec.kwargs) if spec else {}
        unknown = ("engine", "integrator", "observation_noise", "duration", "fallback", "max_speed")
        self.settings = SimpleNamespace(**dict.fromkeys((*unknown, "start")))
        self.timing = SimpleNamespace(
            dt=None,
            control_period=None,
            substeps=None,
            horizon=time_limit(env) or _HORIZON,
            known=False,
        )
        self.plant = SimpleNamespace(
            name=type(env.unwrapped).__name__, coordinates=(), coordinate_units=(), velocities=(),
            velocity_units=(), controls=controls, frame="",
        )  # fmt: skip
        self.task = SimpleNamespace(
            goal=_NO_GOAL, observation_names=names, observation_units=("",) * len(names)
        )
        self.engine = SimpleNamespace(
            version=None, width=None, reports=False, solver=dict, describe=lambda: _said(env)
        )

    def arguments(self) -> dict[str, Any]:
        """Constructor arguments that JSON can hold; of others, how Python prints them."""
        return {name: _plain(value) for name, value in sorted(self._given.items())}

    def units(self) -> dict[str, str]:
        """None is stated."""
        return dict.fromkeys(self._given, "")


def _said(env: gym.Env[Any, Any]) -> Mapping[str, Any]:
    """What a record says of an environment that is not known."""
    left_out = [
        f"{name} ({_count(space)} numbers)"
        for name, space in (("observation", env.observation_space), ("action", env.action_space))
        if not _size(space)
    ]
    return {
        "known": False,
        "unknown": "engine, integrator, steps, state, energy and success",
        "wrappers": list(_wrappers(env)),
        "left_out": left_out,
        "observation_space": _described(env.observation_space),
        "action_space": _described(env.action_space),
    }


def _described(space: gym.Space[Any]) -> dict[str, Any]:
    """A space, of which boxes and discrete sets can be made again."""
    kind = {"kind": type(space).__name__}
    if isinstance(space, gym.spaces.Discrete):
        return {**kind, "n": int(space.n), "start": int(space.start)}
    if not isinstance(space, gym.spaces.Box):
        return kind
    return {**kind, "shape": list(space.shape), "dtype": str(space.dtype)}


def _wrappers(env: Any) -> Iterator[str]:
    """Classes between the recorder and the environment, the outermost first."""
    while env is not env.unwrapped:
        yield type(env).__name__
        env = env.env


def _numbers(space: gym.Space[Any], value: Any) -> list[float]:
    """A value of a space as numbers."""
    if isinstance(space, gym.spaces.Discrete):
        return [float(np.asarray(value).item())]
    flat: Any = gym.spaces.flatten(space, value)
    numbers: list[float] = np.ravel(flat).astype(np.float64).tolist()
    return numbers


def _size(space: gym.Space[Any]) -> int:
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
    try:
        json.dumps(value, allow_nan=False)
    except (TypeError, ValueError):
        return repr(value)
    return value
