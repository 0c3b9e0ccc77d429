"""Controls at the bounds of what actuators can do."""

from __future__ import annotations

import ctypes
import math
import sys
from collections.abc import Callable, Mapping
from copy import copy
from operator import itemgetter
from types import FrameType
from typing import Any, ClassVar

import gymnasium as gym
import numpy as np
import numpy.typing as npt
from gymnasium import spaces
from gymnasium.envs import registration
from gymnasium.envs.registration import EnvSpec

from integ_gym.support.errors import InputError, InputTypeError

from .lanes import Array
from .ops.ops import SCALAR, Components
from .plants.interface import split_state
from .registries import PLANTS, TASKS
from .settings import Setup, build_setup
from .starts import (
    NOISE,
    check_starts,
    checked_episodes,
    draw_start,
    stream_of_episode,
)
from .steps import (
    WARM_UP,
    ScalarStart,
    ScalarStep,
    plain_start,
    plain_step,
    traced_start,
    traced_step,
)
from .tasks.interface import FLOAT32_ROUNDING
from .transition import (
    STATUS_NAMES,
    EnvState,
    quiet_status,
    sensed,
    top_speed,
)


def at_bounds(control: Array, low: Array, high: Array) -> bool:
    """Whether some control is at a bound or beyond it, as where a policy clips to it in float32.

    Args:
        control: asked for, any shape.
        low: least of each, infinite without a bound.
        high: most of each.
    """
    below = low + FLOAT32_ROUNDING * _finite(low)
    above = high - FLOAT32_ROUNDING * _finite(high)
    return bool(((control <= below) | (control >= above)).any())


def _finite(bound: Array) -> Array:
    return np.where(np.isfinite(bound), np.abs(bound), 0.0)


Observation = npt.NDArray[np.float32]

_OF_LANES = ("mixture", "compiled")
"""Arguments of vector environments alone."""


class IntegEnv(gym.Env[Observation, Any]):
    """An environment whose discretization is given by constructor arguments.

    Subclasses name a task and their own defaults; see their docstrings for the arguments.
    """

    task_name: ClassVar[str]
    defaults: ClassVar[Mapping[str, Any]]
    metadata: dict[str, Any] = {  # noqa: RUF012
        "render_modes": ["human", "rgb_array"],
        "render_fps": 30,
    }

    def __init__(self, *, render_mode: str | None = None, **arguments: Any) -> None:
        for name in _OF_LANES:
            if name in arguments:
                raise InputTypeError(
                    f"`{name}` is for many environments; give it to gym.make_vec, without a "
                    "`vectorization_mode`"
                )
        for name, value in arguments.items():
            if isinstance(value, np.ndarray) and value.ndim:
                raise InputError(
                    f"`{name}` must be one value, got an array; give arrays to gym.make_vec"
                )
        self.setup = make_setup(type(self), arguments)
        self.render_mode = checked_render_mode(render_mode, self.metadata["render_modes"])
        self.metadata = {
            **type(self).metadata,
            "render_fps": frames_per_second(self.setup),
        }
        self.action_space = self.setup.action_space
        self.observation_space = observation_space(self.setup)  # type: ignore[assignment]
        self._discrete = self.setup.task.discrete
        self._choices = {choice: float(choice) for choice in range(self._discrete or 0)}
        self._noise = self.setup.settings.observation_noise
        self._in_order = _interleaved(len(self.setup.plant.coordinates))
        self.episode = -1
        """How many episodes have begun since the last seed, before this one."""
        self._state: EnvState | None = None
        self._control = 0.0
        self._sampled = True
        self._terminated = self._warned = False
        self.status_code = quiet_status(self.setup)
        """The solver's status in the last step, as a code of `STATUS_NAMES`."""
        self._spec: EnvSpec | None = None
        self._start: ScalarStart = plain_start(self.setup)
        self._step: ScalarStep = self._first_steps
        self._steps_to_trace = WARM_UP
        self._renderer: Any = None

    @property
    def spec(self) -> EnvSpec | None:
        """What ``gym.make`` made it from, with the decisions of an episode; None without it."""
        return self._spec

    @spec.setter
    def spec(self, spec: EnvSpec | None) -> None:
        makers = running_makers()
        if makers and makers[0] is sys._getframe(1):
            self.setup = _limited_in_make(self.setup, type(self), makers)
        self._start, self._step = plain_start(self.setup), self._first_steps
        self._spec = with_horizon(spec, self.setup)

    def __getstate__(self) -> dict[str, Any]:
        """Without traced functions and drawing surfaces, which are made again."""
        left_out = ("_start", "_step", "_renderer")
        return {name: value for name, value in self.__dict__.items() if name not in left_out}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._renderer = None
        self._start, self._step = plain_start(self.setup), self._first_steps
        if self._steps_to_trace <= 0:
            self._trace()

    @classmethod
    def task_class(cls) -> type[Any]:
        """The class of the environment's task."""
        return TASKS.load(cls.task_name)

    @property
    def state(self) -> npt.NDArray[np.float64]:
        """True state in Gymnasium's order, SI units, shape (n,).

        Raises:
            gymnasium.error.ResetNeeded: before the first reset.
        """
        return np.array(self.state_components, dtype=np.float64)

    @property
    def state_components(self) -> Components:
        """The same as floats, which takes less time."""
        current = self._current()
        return self._in_order(current.q + current.v)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Start an episode.

        Args:
            seed: seeds the environment's generator.
            options: ``state``: the start in Gymnasium's order; or the bounds of the start
                distribution, named as in Gymnasium (`x_init`, `y_init`; `low`, `high`).
                ``episode``: the number of the episode since the seed, whose sensor noise is drawn.

        Raises:
            ValueError: for a bound or state that is not possible.
        """
        super().reset(seed=seed)
        options = options or {}
        self.episode = 0 if seed is not None else self.episode + 1
        if "episode" in options:
            self.episode = int(checked_episodes(options["episode"], ()))
        q, v = split_state(draw_start(self.setup, self.np_random, options))
        if "state" not in options:
            q = self.setup.system.confined(SCALAR, q)
        state, observation, info = self._start(q, v)
        self._state = EnvState._make(state)
        if self._noise:
            self._noise_stream = stream_of_episode(self.np_random, NOISE, self.episode)
        self._control, self._sampled = 0.0, True
        self._terminated = self._warned = False
        self.status_code = info["solver_status"]
        info["solver_status"] = STATUS_NAMES[self.status_code]
        if self.render_mode == "human":
            self.render()
        return self._observed(observation), info

    def step(self, action: Any) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Advance one control period; see the environment's docstring for ``info``.

        After a termination, a step that ends beyond it again pays the least that a step can, with
        a warning: 0 where falling ends the episode of a cart-pole.

        Raises:
            ValueError: for an action of the wrong shape or outside a `Discrete` space.
            gymnasium.error.ResetNeeded: before the first reset.
        """
        before = self._current()
        control = self._read_action(action)
        try:
            taken = self._step(before, control)
        except (ArithmeticError, ValueError):
            taken = plain_step(self.setup)(before, control)
        state, observation, reward, terminated, truncated, info, self._sampled = taken
        self._state, self._control = EnvState._make(state), info["control"]
        self.status_code = info["solver_status"]
        info["solver_status"] = STATUS_NAMES[self.status_code]
        if terminated and self._terminated:
            reward = self._reward_after_the_end()
        self._terminated = self._terminated or terminated
        if self.render_mode == "human":
            self.render()
        return self._observed(observation), reward, terminated, truncated, info

    def render(self) -> npt.NDArray[np.uint8] | None:
        """Draw the plant, the applied control and the discretization.

        Raises:
            ModuleNotFoundError: without pygame, with the command that installs it.
        """
        if self.render_mode is None:
            gym.logger.warn(
                "render() does nothing without a render mode; give render_mode="
                '"rgb_array" or "human" to gym.make'
            )
            return None
        if self._renderer is None:
            from .rendering.renderer import Renderer

            self._renderer = Renderer(self.setup, self.render_mode, self.metadata["render_fps"])
        time = self._current().steps * self.setup.timing.control_period
        frame: npt.NDArray[np.uint8] | None = self._renderer.draw(self.state, self._control, time)
        return frame

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None

    def _reward_after_the_end(self) -> float:
        """The least that a step can pay; the first time with a warning."""
        if not self._warned:
            self._warned = True
            gym.logger.warn(
                "the episode has terminated; call reset(), further steps pay the least of a step"
            )
        setup = self.setup
        period = setup.timing.control_period
        return float(setup.task.worst_return(SCALAR, 1, period, top_speed(setup)))

    def _current(self) -> EnvState:
        if self._state is None:
            raise gym.error.ResetNeeded("call reset() before step(), state or render()")
        return self._state

    def _read_action(self, action: Any) -> float:
        if self._discrete is None:
            return box_action(action)
        try:
            return self._choices[action]
        except (KeyError, TypeError):
            return discrete_action(action, self._discrete)

    def _first_steps(self, state: EnvState, action: float) -> tuple[Any, ...]:
        """Steps until it pays to have them traced."""
        self._steps_to_trace -= 1
        if self._steps_to_trace <= 0:
            self._trace()
        return plain_step(self.setup)(state, action)

    def _trace(self) -> None:
        """Go on by traced functions, where there are any."""
        self._step = traced_step(self.setup) or plain_step(self.setup)
        self._start = traced_start(self.setup) or plain_start(self.setup)

    def _observed(self, observation: Components) -> Observation:
        """The last sample, with any noise drawn for it, saturated at the space's bounds."""
        if not self._noise:
            return np.array(observation, dtype=np.float32)
        state = self._current()
        if self._sampled:
            drawn = self._noise_stream.standard_normal(2 * len(state.q))
            self._sample_noise = tuple((self._noise * drawn).tolist())
        q, v = sensed(state, self._sample_noise)
        noisy = np.array(self.setup.task.observe(SCALAR, q, v), dtype=np.float32)
        return np.clip(noisy, self.observation_space.low, self.observation_space.high)  # type: ignore[attr-defined]


def make_setup(env: type[Any], arguments: Mapping[str, Any]) -> Setup:
    """The setup of an environment class from its constructor arguments."""
    task = env.task_class()
    setup = build_setup(PLANTS.load(task.plant), task, env.defaults, arguments)
    check_starts(setup)
    return setup


def with_horizon(spec: EnvSpec | None, setup: Setup) -> EnvSpec | None:
    """A copy of what Gymnasium says of an environment, with the decisions of an episode."""
    if spec is None:
        return None
    told = copy(spec)
    told.max_episode_steps = setup.timing.horizon
    return told


def running_makers() -> list[FrameType]:
    """The calls of Gymnasium's ``make`` and ``make_vec`` that are running, innermost first.

    They are known by module and name, so that it does not matter who has wrapped ``gym.make``.
    """
    found = []
    frame: FrameType | None = sys._getframe(1)
    while frame is not None:
        ours = frame.f_globals.get("__name__") == registration.__name__
        if ours and frame.f_code.co_name in ("make", "make_vec"):
            found.append(frame)
        frame = frame.f_back
    return found


def is_own_horizon(
    limit: int | None, makers: list[FrameType], horizon_of: Callable[[Mapping[str, Any]], int]
) -> bool:
    """Whether a limit is only what the spec of a made environment says, and nobody asked for it.

    It is if it is the horizon of the arguments in that spec, and the id is not registered with it.

    Args:
        limit: decisions that the spec says.
        makers: see :func:`running_makers`.
        horizon_of: gives the horizon of those arguments of a spec that determine it.
    """
    given = [maker.f_locals.get("id") for maker in makers]
    specs = [spec for spec in given if isinstance(spec, EnvSpec)]
    if limit is None or not specs or not isinstance(given[0], EnvSpec):
        return False
    # make_vec gives make the arguments of the spec apart from it
    spec = [spec for spec in specs if spec.id == specs[0].id][-1]
    registered = gym.registry.get(spec.id)
    if registered is not None and registered.max_episode_steps == limit:
        return False
    names = ("dt", "control_period", "duration", "mixture")
    return limit == horizon_of({n: spec.kwargs[n] for n in names if n in spec.kwargs})


def _limited_in_make(setup: Setup, env: type[IntegEnv], makers: list[FrameType]) -> Setup:
    """A setup with the `max_episode_steps` of the ``gym.make`` that is making its environment.

    Gymnasium tells them to its `TimeLimit` alone, which could end an episode sooner than the
    environment and never later: so they are read where ``gym.make`` keeps them.
    """
    making = makers[0].f_locals
    asked: int | None = making.get("max_episode_steps")
    spec: EnvSpec | None = making.get("env_spec")
    if asked is not None or spec is None:
        return setup.limited(asked)
    limit, horizon = spec.max_episode_steps, setup.timing.horizon
    if not is_own_horizon(limit, makers, lambda a: make_setup(env, a).timing.horizon):
        return setup.limited(limit)
    if limit == horizon:
        return setup
    if any(maker.f_locals.get("env_spec") is spec for maker in makers[1:]):
        spec.max_episode_steps = horizon  # the copy that make_vec has made
    else:
        making["max_episode_steps"] = horizon  # of the `TimeLimit`; the spec is the user's
        if sys.version_info < (3, 13):
            ctypes.pythonapi.PyFrame_LocalsToFast(ctypes.py_object(makers[0]), ctypes.c_int(0))
    return setup


def frames_per_second(setup: Setup) -> int:
    """Frames that show an episode in its own time, one per decision."""
    return max(1, round(1.0 / setup.timing.control_period))


def checked_render_mode(render_mode: str | None, modes: list[str]) -> str | None:
    """``render_mode`` if it is one.

    Raises:
        ValueError: otherwise, with the valid modes.
    """
    if render_mode is not None and render_mode not in modes:
        raise InputError(f"`render_mode` must be one of {modes} or None, got {render_mode!r}")
    return render_mode


def observation_space(setup: Setup) -> spaces.Box:
    """`Box` within the task's observation limits."""
    limits = setup.task.observation_limits(setup.settings.max_speed)
    high = np.array([np.max(limit) for limit in limits], dtype=np.float32)
    return spaces.Box(-high, high, dtype=np.float32)


def _interleaved(count: int) -> Callable[[Components], Components]:
    """From (q0, q1, …, v0, v1, …) to state order."""
    order = [place for k in range(count) for place in (k, count + k)]
    return itemgetter(*order)


_NO_ACTIONS = (str, bytes, bytearray, set, frozenset, dict)
"""What holds one thing that can be made a number, and is no action."""


def box_action(action: Any) -> float:
    """The one entry of a `Box` action as float; infinite where a float cannot hold it.

    Raises:
        ValueError: if the action does not have shape (1,).
    """
    try:
        (value,) = action.tolist() if type(action) is np.ndarray else action
        if isinstance(value, (str, bytes)) or isinstance(action, _NO_ACTIONS):
            raise TypeError
        return float(value)
    except OverflowError:
        return math.inf
    except (TypeError, ValueError):
        raise InputError(
            f"action must have shape (1,), got {shown(action)} of shape {np.shape(action)}"
        ) from None


def discrete_action(action: Any, count: int) -> float:
    """A `Discrete` action, or NaN for a non-finite one.

    Raises:
        ValueError: if it is neither finite nor one of 0 … count - 1.
    """
    try:
        value = float(action)
    except (TypeError, ValueError, OverflowError):
        value = -1.0
    if math.isnan(value) or math.isinf(value):
        return math.nan
    if value not in range(count):
        choices = ", ".join(map(str, range(count)))
        raise InputError(f"action must be one of {choices}, got {shown(action)}")
    return value


def shown(action: Any) -> str:
    """An action as a message shows it: not in full where it is long."""
    try:
        return f"{action!r:.60}"
    except ValueError:  # a whole number of more digits than Python writes
        return "a number of thousands of digits"
