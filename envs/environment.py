"""The single environment, and the class and setup that an environment id stands for."""

from __future__ import annotations

import ctypes
import importlib
import math
import re
import sys
from collections.abc import Callable, Mapping, Sequence
from copy import copy
from functools import cache, partial
from operator import itemgetter
from types import FrameType
from typing import Any, ClassVar, Final

import gymnasium as gym
import numpy as np
import numpy.typing as npt
from gymnasium import spaces
from gymnasium.envs import registration
from gymnasium.envs.registration import EnvSpec, load_env_creator

from integ_gym.support.errors import InputError, InputTypeError
from integ_gym.support.parameters import unknown_name

from . import starts
from .ops.ops import SCALAR, Array, Components, split_state
from .registries import ENVIRONMENTS, PLANTS, TASKS
from .settings import NO_LIMIT, Mixture, Setup, build_setup, make_mixture
from .steps import WARM_UP, trace_function
from .tasks.interface import FLOAT32_ROUNDING, to_public_order
from .transition import (
    STATUS_NAMES,
    EnvState,
    control_columns,
    quiet_status,
    scalar_start,
    scalar_step,
    sensed_state,
    top_speed,
)


def within_rounding(low: Array, high: Array) -> tuple[Array, Array]:
    """Bounds of controls, infinite where there are none, drawn in by the rounding of float32."""
    sizes = [np.where(np.isfinite(end), np.abs(end), 0.0) for end in (low, high)]
    return low + FLOAT32_ROUNDING * sizes[0], high - FLOAT32_ROUNDING * sizes[1]


def at_bounds(control: Array, ends: tuple[Array, Array]) -> bool:
    """Whether some control is at a bound or beyond it, as where a policy clips to it in float32.

    Args:
        control: asked for, any shape.
        ends: see :func:`within_rounding`.
    """
    return bool(((control <= ends[0]) | (control >= ends[1])).any())


Observation = npt.NDArray[np.float32]


class IntegEnv(gym.Env[Observation, Any]):
    """An environment whose discretization is given by constructor arguments.

    Subclasses name a task and their own defaults; see their docstrings for the arguments.

    Args:
        render_mode: ``"human"``, ``"rgb_array"`` or None.
        mixture: discretizations (dicts of ``integrator``, ``dt``, … and, optionally, ``weight``),
            one of which every reset draws, and with it how often the episode decides.
        arguments: those of the task, the plant and every environment.

    Attributes:
        mixture: the discretizations that episodes run on; one where it is no mixture.
        setup: what this episode runs on.
    """

    task_name: ClassVar[str]
    other_tasks: ClassVar[Mapping[str, str]] = {}
    """Arguments that stand for another task where they are given, and that task's name."""
    defaults: ClassVar[Mapping[str, Any]]
    metadata: dict[str, Any] = {  # noqa: RUF012
        "render_modes": ["human", "rgb_array"],
        "render_fps": 30,
    }

    def __init__(
        self,
        *,
        render_mode: str | None = None,
        mixture: Sequence[Mapping[str, Any]] | None = None,
        **arguments: Any,
    ) -> None:
        if "compiled" in arguments:
            raise InputTypeError(
                "`compiled` is for many environments; give it to gym.make_vec, without a "
                "`vectorization_mode`"
            )
        for name, value in arguments.items():
            if isinstance(value, np.ndarray) and value.ndim:
                raise InputError(
                    f"`{name}` must be one value, got an array; give arrays to gym.make_vec"
                )
        self.mixed = mixture is not None
        self.mixture = make_setups(type(self), {**arguments, "mixture": mixture})
        self.setup = self.mixture.setups[0]
        self._member = 0
        self.render_mode = check_render_mode(render_mode, self.metadata["render_modes"])
        self.metadata = {
            **type(self).metadata,
            "render_fps": frames_per_second(self.setup),
        }
        self.action_space = self.setup.action_space
        self.observation_space = observation_space(self.setup)  # type: ignore[assignment]
        self._discrete = self.setup.task.discrete
        self._choices = {choice: (float(choice),) for choice in range(self._discrete or 0)}
        self._noise = self.setup.settings.observation_noise
        count = len(self.setup.plant.coordinates)
        order = (place for k in range(count) for place in (k, count + k))
        self._in_order: Callable[[Components], Components] = itemgetter(*order)
        self.episode = -1
        """How many episodes have begun since the last seed, before this one."""
        self._state: EnvState | None = None
        self._applied = [applied for _, applied in control_columns(self.setup.plant)]
        self._controls = self._idle = (0.0,) * len(self._applied)
        self._sampled = True
        self._terminated = self._warned = False
        self.status_code = quiet_status(self.setup)
        """The solver's status in the last step, as a code of `STATUS_NAMES`."""
        self._spec: EnvSpec | None = None
        self._start, self._step = self._build_untraced()
        self._functions: dict[int, tuple[Any, Any]] = {}
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
            self.mixture = _limit_in_make(self.mixture, type(self), makers)
            self.setup = self.mixture.setups[self._member]
        self._begin_untraced()
        self._spec = with_horizon(spec, self.mixture)

    def __getstate__(self) -> dict[str, Any]:
        """Without traced functions and drawing surfaces, which are made again."""
        left_out = ("_start", "_step", "_functions", "_renderer")
        return {name: value for name, value in self.__dict__.items() if name not in left_out}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._renderer = None
        self._begin_untraced()
        if self._steps_to_trace <= 0:
            self._trace()

    @classmethod
    def task_class(cls) -> type[Any]:
        """The class of the environment's task."""
        return TASKS.load(cls.task_name)

    @property
    def state(self) -> npt.NDArray[np.float64]:
        """True state, in the order that the environment's docstring states, SI units, shape (n,).

        Raises:
            gymnasium.error.ResetNeeded: before the first reset.
        """
        components = np.array(self.state_components, dtype=np.float64)
        return to_public_order(self.setup.task, components)

    @property
    def state_components(self) -> Components:
        """The same in state order (q0, v0, q1, v1, …), as floats, which takes less time."""
        current = self._current()
        return self._in_order(current.q + current.v)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Start an episode.

        Args:
            seed: seeds the environment's generator.
            options: ``state``: the start, in the order of :attr:`state`; or the bounds of the start
                distribution, named as in Gymnasium (`x_init`, `y_init`; `low`, `high`).
                ``episode``: the number of the episode since the seed, whose sensor noise and
                arrivals of commands are drawn. In a mixture ``mixture_index`` gives the member
                instead of drawing it.

        Raises:
            ValueError: for a bound, state or member that is not possible.
        """
        super().reset(seed=seed)
        options = dict(options or {})
        self.episode = 0 if seed is not None else self.episode + 1
        if "episode" in options:
            self.episode = int(starts.parse_episodes(options["episode"], ()))
        if self.mixed:
            self._take_member(options.pop("mixture_index", None))
        q, v = split_state(starts.draw_start(self.setup, self.np_random, options))
        if "state" not in options:
            q = self.setup.system.confine(SCALAR, q)
        state, observation, info = self._start(q, v)
        self._state = EnvState._make(state)
        if self._noise:
            self._noise_stream = starts.stream_of_episode(
                self.np_random, starts.NOISE, self.episode
            )
        if self.setup.timing.drawn:
            self._arrivals = starts.stream_of_episode(self.np_random, starts.ARRIVAL, self.episode)
        self._controls, self._sampled = self._idle, True
        self._terminated = self._warned = False
        self.status_code = info["solver_status"]
        info["solver_status"] = STATUS_NAMES[self.status_code]
        if self.mixed:
            info["mixture_index"] = self._member
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
        given: tuple[Any, ...] = (self._read_action(action),)
        if before.arrivals:
            given = tuple(self._arrivals.random(2).tolist()), *given
        try:
            taken = self._step(before, *given)
        except (ArithmeticError, ValueError):
            taken = scalar_step(self.setup, SCALAR, before, *given)
        state, observation, reward, terminated, truncated, info, self._sampled = taken
        self._state = EnvState._make(state)
        self.status_code = info["solver_status"]
        info["solver_status"] = STATUS_NAMES[self.status_code]
        if self.mixed:
            info["mixture_index"] = self._member
        if terminated and self._terminated:
            if not self._warned:
                gym.logger.warn(
                    "the episode has terminated; call reset(), further steps pay the least of a "
                    "step"
                )
            self._warned, setup = True, self.setup
            period = setup.timing.control_period
            reward = float(setup.task.worst_return(SCALAR, 1, period, top_speed(setup)))
        self._terminated = self._terminated or terminated
        if self.render_mode is not None:
            self._controls = tuple([info[name] for name in self._applied])
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
        state = np.array(self.state_components)
        frame: npt.NDArray[np.uint8] | None = self._renderer.draw(state, self._controls, time)
        return frame

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None

    def _current(self) -> EnvState:
        if self._state is None:
            raise gym.error.ResetNeeded("call reset() before step(), state or render()")
        return self._state

    def _read_action(self, action: Any) -> tuple[float, ...]:
        if self._discrete is None:
            return box_action(action, len(self._applied))
        try:
            return self._choices[action]
        except (KeyError, TypeError):
            return (discrete_action(action, self._discrete),)

    def _take_member(self, given: Any) -> None:
        """Run on a member of the mixture from this episode on; None draws it."""
        if given is None:
            number = starts.stream_of_episode(self.np_random, starts.MEMBER, self.episode).random()
            member = self.mixture.member(number)
        else:
            member = int(starts.parse_members(given, (), len(self.mixture.setups)))
        if member == self._member:
            return
        self._functions[self._member] = self._start, self._step
        self._member, self.setup = member, self.mixture.setups[member]
        self._start, self._step = self._functions.get(member) or self._build_untraced()
        if self._renderer is not None:
            self._renderer.setup = self.setup

    def _build_untraced(self) -> tuple[Any, Any]:
        """Start and step of the setup before it pays to have them traced."""
        return partial(scalar_start, self.setup, SCALAR), self._first_steps

    def _begin_untraced(self) -> None:
        self._start, self._step = self._build_untraced()
        self._functions = {}

    def _first_steps(self, state: EnvState, *given: Any) -> tuple[Any, ...]:
        """Steps until it pays to have them traced."""
        self._steps_to_trace -= 1
        if self._steps_to_trace <= 0:
            self._trace()
        return scalar_step(self.setup, SCALAR, state, *given)

    def _trace(self) -> None:
        """Go on by traced functions, where there are any."""
        step, start = (trace_function(self.setup, f) for f in (scalar_step, scalar_start))
        self._step = step or partial(scalar_step, self.setup, SCALAR)
        self._start = start or partial(scalar_start, self.setup, SCALAR)

    def _observed(self, observation: Components) -> Observation:
        """The last sample, with any noise drawn for it, saturated at the space's bounds."""
        if not self._noise:
            return np.array(observation, dtype=np.float32)
        state = self._current()
        if self._sampled:
            drawn = self._noise_stream.standard_normal(2 * len(state.q))
            self._sample_noise = tuple((self._noise * drawn).tolist())
        q, v = sensed_state(state, self._sample_noise)
        noisy = np.array(self.setup.task.observe(SCALAR, q, v), dtype=np.float32)
        return np.clip(noisy, self.observation_space.low, self.observation_space.high)  # type: ignore[attr-defined]


def task_of(env: type[Any], arguments: Mapping[str, Any]) -> type[Any]:
    """The class of the task that an environment class has, given these constructor arguments."""
    asked = (task for name, task in env.other_tasks.items() if arguments.get(name) is not None)
    other = next(asked, None)
    return TASKS.load(other) if other else env.task_class()


def make_setup(env: type[Any], arguments: Mapping[str, Any]) -> Setup:
    """The setup of an environment class from its constructor arguments."""
    task = task_of(env, arguments)
    arguments = {k: x for k, x in arguments.items() if x is not None or k not in env.other_tasks}
    setup = build_setup(PLANTS.load(task.plant), task, env.defaults, arguments)
    starts.check_starts(setup)
    return setup


def with_horizon(spec: EnvSpec | None, mixture: Mixture) -> EnvSpec | None:
    """A copy of what Gymnasium says of an environment, with the decisions of an episode.

    Of a mixture, those of its longest episode: the environment truncates the others itself. None
    where there is no limit, which `duration` says then.
    """
    if spec is None:
        return None
    spec = copy(spec)
    spec.max_episode_steps = mixture.horizon
    if mixture.horizon >= NO_LIMIT:
        spec.max_episode_steps = None
        spec.kwargs = {
            **spec.kwargs,
            "duration": max(setup.settings.duration for setup in mixture.setups),
        }
    return spec


def make_setups(env: type[Any], arguments: Mapping[str, Any]) -> Mixture:
    """The setups of an environment class from its arguments, ``mixture`` among them or not."""
    others = {name: value for name, value in arguments.items() if name != "mixture"}
    return make_mixture(partial(make_setup, env), others, arguments.get("mixture"))


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
    """Whether a limit is only what the spec of a made environment says, and was not asked for.

    It is if it is the horizon of the arguments in that spec, and no id of another package is
    registered with it.

    Args:
        limit: decisions that the spec says.
        makers: see :func:`running_makers`.
        horizon_of: gives the horizon of those arguments of a spec that determine it.
    """
    given = [maker.f_locals["id"] for maker in makers if "id" in maker.f_locals]
    specs = [x if isinstance(x, EnvSpec) else gym.spec(x.rpartition(":")[2]) for x in given]
    if limit is None or not specs:
        return False
    # make_vec gives make the arguments of the spec apart from it
    spec = [spec for spec in specs if spec.id == specs[0].id][-1]
    registered = gym.registry.get(spec.id)
    if spec.id not in ENVIRONMENTS and registered and registered.max_episode_steps == limit:
        return False
    names = ("dt", "control_period", "duration", "mixture")
    return limit == horizon_of({n: spec.kwargs[n] for n in names if n in spec.kwargs})


def _limit_in_make(mixture: Mixture, env: type[IntegEnv], makers: list[FrameType]) -> Mixture:
    """Setups with the `max_episode_steps` of the ``gym.make`` that is making their environment.

    Gymnasium gives them to its `TimeLimit` alone, which could end an episode sooner than the
    environment and never later: so they are read where ``gym.make`` keeps them.
    """
    making = makers[0].f_locals
    asked: int | None = making.get("max_episode_steps")
    spec: EnvSpec | None = making.get("env_spec")
    if asked is not None or spec is None:
        return mixture.limited(asked)
    limit, horizon = spec.max_episode_steps, mixture.horizon
    if not is_own_horizon(limit, makers, lambda given: make_setups(env, given).horizon):
        return mixture.limited(limit)
    if limit == horizon:
        return mixture
    if any(maker.f_locals.get("env_spec") is spec for maker in makers[1:]):
        spec.max_episode_steps = horizon  # the copy that make_vec has made
    else:
        making["max_episode_steps"] = horizon  # of the `TimeLimit`; the spec is the user's
        if sys.version_info < (3, 13):
            ctypes.pythonapi.PyFrame_LocalsToFast(ctypes.py_object(makers[0]), ctypes.c_int(0))
    return mixture


def frames_per_second(setup: Setup) -> int:
    """Frames that show an episode in its own time, one per decision."""
    return max(1, round(1.0 / setup.timing.control_period))


def check_render_mode(render_mode: str | None, modes: list[str]) -> str | None:
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


_NO_ACTIONS = (str, bytes, bytearray, set, frozenset, dict)
"""What holds one thing that can be made a number, and is no action."""


def box_action(action: Any, count: int) -> tuple[float, ...]:
    """The entries of a `Box` action as floats; infinite where a float cannot hold one.

    Raises:
        ValueError: if the action does not have shape (count,).
    """
    if type(action) is np.ndarray and action.dtype.kind == "f" and action.shape == (count,):
        return tuple(action.tolist())
    try:
        values = [*action]
        if len(values) != count or isinstance(action, _NO_ACTIONS):
            raise TypeError
        for value in values:
            if isinstance(value, (str, bytes)):
                raise TypeError
        return tuple([float(value) for value in values])
    except OverflowError:
        return (math.inf,) * count
    except (TypeError, ValueError):
        raise InputError(
            f"action must have shape ({count},), got {format_action(action)} of shape "
            f"{np.shape(action)}"
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
        raise InputError(f"action must be one of {choices}, got {format_action(action)}")
    return value


def format_action(action: Any) -> str:
    """An action as a message shows it: not in full where it is long."""
    try:
        return f"{action!r:.60}"
    except ValueError:  # a whole number of more digits than Python writes
        return "a number of thousands of digits"


_OWN_ID = re.compile(r"(?P<module>[\w.]+):(?P<name>[\w/-]+-v\d+)")

OWN_ENVIRONMENT: Final = 'your own IntegEnv as "module:Id-v0"'
"""What is taken beside :data:`ENVIRONMENTS` where the equations of motion are needed."""

OTHER_TESTBEDS: Final = (
    "a task of Gymnasium's such as Acrobot-v1 or Hopper-v5, one of another library's such as "
    'brax:ant, your own as "module:Id-v0", or a testbed of your own as "module:Class"'
)
"""What is taken beside :data:`ENVIRONMENTS` where any testbed is."""


def is_integ_environment(env_id: str) -> bool:
    """Whether an id is of an :class:`IntegEnv`: one of ours, or ``"my_task:Settle-v0"``.

    Raises:
        ValueError: if the module that such an id names cannot be imported, or registers no such id.
    """
    return env_id in ENVIRONMENTS or _own_class(env_id) is not None


def environment_class(env_id: str) -> type[IntegEnv]:
    """The single environment's class.

    Args:
        env_id: one of ours, or one that a module registers, in Gymnasium's notation
            ``"module:Id-v0"``.

    Raises:
        ValueError: for an id that is of no :class:`IntegEnv`, with the valid ones.
    """
    if env_id in ENVIRONMENTS:
        return load_env_creator(f"{ENVIRONMENTS[env_id]}Env")  # type: ignore[return-value]
    own = _own_class(env_id)
    if own is None:
        if ":" not in env_id and env_id not in gym.registry:
            unknown = unknown_name("environment", env_id, ENVIRONMENTS)
            raise InputError(f"{unknown}, or {OWN_ENVIRONMENT}")
        raise InputError(
            f"{env_id!r} does not give its equations of motion, which are needed here; give "
            f"{', '.join(sorted(ENVIRONMENTS))}, or {OWN_ENVIRONMENT}"
        )
    return own


@cache
def _own_class(env_id: str) -> type[IntegEnv] | None:
    """The class of an id in Gymnasium's notation; None if it is none, or no :class:`IntegEnv`."""
    named = _OWN_ID.fullmatch(env_id)
    if named is None:
        return None
    module, name = named["module"], named["name"]
    try:
        importlib.import_module(module)
    except Exception as error:  # whatever the user's module does while it is imported
        raise InputError(
            f"cannot import {module!r} of {env_id!r}: {type(error).__name__}: {error}; start where "
            "its file lies, or put its folder on PYTHONPATH"
        ) from error
    if name not in gym.registry:
        raise InputError(
            f"{module!r} registers no environment {name!r}; call gymnasium.register in it"
        )
    entry = gym.registry[name].entry_point
    owner = load_env_creator(entry) if isinstance(entry, str) else entry
    return owner if isinstance(owner, type) and issubclass(owner, IntegEnv) else None


def environment_setup(env_id: str, arguments: Mapping[str, Any]) -> Setup:
    """Plant, task, timing and engine that an id and its constructor arguments stand for.

    Raises:
        TypeError, ValueError: for what the environment's constructor refuses.
    """
    return make_setup(environment_class(env_id), arguments)


def environment_mixture(env_id: str, arguments: Mapping[str, Any]) -> Mixture:
    """The discretizations that an id and the arguments of its vector environment stand for.

    Args:
        env_id: a registered id.
        arguments: constructor arguments, ``mixture`` included or not.

    Raises:
        TypeError, ValueError: for what the environment's constructor refuses.
    """
    return make_setups(environment_class(env_id), arguments)
