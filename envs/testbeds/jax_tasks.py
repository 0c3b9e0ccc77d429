"""Tasks of libraries that pass their state: MuJoCo Playground and Brax."""

from __future__ import annotations

import json
from collections.abc import Sequence
from functools import lru_cache
from importlib import import_module
from typing import Any, ClassVar

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from gymnasium.envs.registration import EnvSpec
from gymnasium.wrappers import TimeLimit
from numpy.typing import NDArray

from integ_gym.support.errors import InputError
from integ_gym.support.optional import check_versions, load
from integ_gym.support.parameters import unknown_name

from ..lanes import DiscretizedVectorEnv
from ..rediscretized import plant_of
from ..settings import Discretization
from .boundaries import ACTUATORS, Boundaries, Named, intercept, name_components, number_components
from .gym_testbed import Applied, GymTestbed, split_period, without_stated


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
        self._reset, self._step = _compile_task(inner)
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
        self._state = self._advance(np.asarray(action, np.float32))
        reward, done = float(self._state.reward), bool(self._state.done)
        return self._observation(), reward, done, False, {}

    def _advance(self, action: NDArray[np.float32]) -> Any:
        """The state after a decision."""
        return self._step(self._state, action)

    def _observation(self) -> NDArray[np.float32]:
        observed = self._state.obs
        chosen = observed[self._entry] if isinstance(observed, dict) else observed
        return np.array(chosen, np.float32)


@lru_cache(maxsize=32)
def _compile_task(inner: Any) -> tuple[Any, Any]:
    """Reset and step: one program each, for all lanes of a task and all of its states."""
    return _jit(inner.reset), _jit(inner.step)


def _jit(function: Any) -> Any:
    """Compiled, without JAX's weak types, with which a later state would be another program's."""
    jax = load("jax", "fleet")

    def typed(leaf: Any) -> Any:
        array = jax.numpy.asarray(leaf)
        return array.astype(array.dtype)

    return jax.jit(lambda *given: jax.tree.map(typed, function(*given)))


def round_trip_step(step: Any) -> float:
    """A step that is kept in single precision, s, as the number that it was given as."""
    return float(str(np.float32(step)))


class StatePassingTestbed(GymTestbed):
    """A task of a library that passes its state; each discretization of it is made once.

    Args:
        task: its name.
        success_return: see :class:`GymTestbed`.
        arguments: of the task.
    """

    def __init__(self, task: str, success_return: float | None, **arguments: Any) -> None:
        super().__init__(success_return, **arguments)
        self.task = self.title = task
        self.registered = EnvSpec(f"{task}-v0")
        self._tasks: dict[Any, Any] = {}


PLAYGROUND = "playground"
INTEGRATORS = {"Euler": 0, "RK4": 1, "implicitfast": 3}
"""MuJoCo's numbers of those that MJX has."""


class PlaygroundEnv(StatePassing):
    """A task of Playground's, in whose decisions other actions may act before their own.

    Attributes:
        earlier: these in the next decision, see :class:`~integ_gym.envs.delayed.SplitDelayed`;
            until a first decision the control of the reset acts.
    """

    earlier: Sequence[tuple[NDArray[np.float32] | None, int]] = ()

    def _advance(self, action: NDArray[np.float32]) -> Any:
        if not self.earlier:
            return self._step(self._state, action)
        count, begin, several = self.inner.n_substeps, 0, False
        actions, held = np.tile(action, (count, 1)), np.zeros(count, bool)
        for one, steps in self.earlier:
            end = begin + steps
            held[begin:end] = one is None
            if one is not None:
                actions[begin:end], several = one, True
            begin = end
        others = actions if several else None
        return _split_step(self.inner)(self._state, action, held, begin, others)


@lru_cache(maxsize=32)
def _split_step(inner: Any) -> Any:
    """The step of a task, compiled, in which other actions act before its own.

    Tasks advance their physics by one function of Playground's, which is given the control; another
    stands in for it while the step is traced. What the task makes of the other actions is taken
    from there as well.

    Raises:
        ValueError: at the first call, for a task that does not call it once.
    """
    jax = load("jax", "fleet")
    module: Any = import_module("mujoco_playground._src.mjx_env")

    def step(state: Any, action: Any, held: Any, own: Any, others: Any) -> Any:
        calls, whole = [], module.step

        def control_of(action: Any) -> Any:
            return intercept(lambda: inner.step(state, action), module, "step", argument=2)

        controls = None if others is None else jax.vmap(control_of)(others)

        def split(model: Any, data: Any, control: Any, count: int = 1) -> Any:
            calls.append(count)
            before, where = data.ctrl, jax.numpy.where

            def one(k: Any, data: Any) -> Any:
                other = before if controls is None else where(held[k], before, controls[k])
                return whole(model, data, where(k < own, other, control))

            return jax.lax.fori_loop(0, count, one, data)

        module.step = split
        try:
            after = inner.step(state, action)
        finally:
            module.step = whole
        if len(calls) != 1:
            raise InputError(
                f"{type(inner).__name__} does not advance its physics by one call, so it has no "
                "`latency_jitter` and an `action_latency` in whole control periods alone"
            )
        return after

    return _jit(step)


class PlaygroundBoundaries(Boundaries):
    """Of a task of Playground's: all four by MJX, in JAX's floats.

    What is observed is known for tasks whose ``_get_obs`` takes data and info, with the info of a
    start: noise and goals are those of a seed.

    Args:
        env: made by :class:`Playground`.
    """

    commands: ClassVar[str] = ACTUATORS
    width = 32

    def __init__(self, env: gym.Env[Any, Any]) -> None:
        super().__init__(env)
        inner: Any = env.unwrapped
        self._lane, self._task = inner, inner.inner
        plant = plant_of(load("mujoco", "mujoco"), self._task.mj_model, "")
        self.coordinates, self.velocities = plant.coordinates, plant.velocities
        self._axes = [name.removesuffix("_dot") for name in plant.velocities]
        self._actuators = [name.removesuffix("_control") for name, _ in plant.controls]
        self._forward = _forward(self._task)

    @property
    def state(self) -> NDArray[np.float64]:
        """Of MJX's data."""
        data = self._lane._state.data
        return np.concatenate([data.qpos, data.qvel]).astype(np.float64)

    def observation(self, state: NDArray[np.float64], seed: int) -> Named | None:
        """What the task makes of it; None where its function takes other things."""
        self.start(seed)
        try:
            shown = self._task._get_obs(self._place(state), self._lane._state.info)
        except (AttributeError, TypeError):
            return None
        entry = self._lane._entry
        return number_components("obs", shown[entry] if isinstance(shown, dict) else shown)

    def command(self, state: NDArray[np.float64], action: Any) -> Named | None:
        """What the task gives its physics, within the actuators' limits."""
        module: Any = import_module("mujoco_playground._src.mjx_env")
        before = self._lane._state.replace(data=self._place(state))
        passed = intercept(lambda: self._task.step(before, action), module, "step", argument=2)
        model = self._task.mj_model
        if passed is None or np.size(passed) != model.nu:
            return None
        bounded = np.clip(np.ravel(passed), *model.actuator_ctrlrange.T)
        limited = model.actuator_ctrllimited.astype(bool)
        return name_components(self._actuators, np.where(limited, bounded, np.ravel(passed)))

    def force(self, state: NDArray[np.float64], command: NDArray[np.float64]) -> Named | None:
        """`qfrc_actuator`."""
        if len(command) != self._task.mj_model.nu:
            return None
        return name_components(self._axes, self._place(state, ctrl=command).qfrc_actuator)

    def acceleration(self, state: NDArray[np.float64], force: NDArray[np.float64]) -> Named | None:
        """`qacc` under the force alone: what actuators do without a command is taken off."""
        if len(force) != self._task.mj_model.nv:
            return None
        idle = np.asarray(self._place(state).qfrc_actuator)
        return name_components(self._axes, self._place(state, qfrc_applied=force - idle).qacc)

    def _place(self, state: NDArray[np.float64], **inputs: NDArray[np.float64]) -> Any:
        """MJX's data in a state, with no control but those given."""
        size, data = self._task.mj_model.nq, self._lane._state.data
        values = {"ctrl": 0.0 * data.ctrl, "qfrc_applied": 0.0 * data.qfrc_applied, **inputs}
        return self._forward(data, state[:size], state[size:], values)


@lru_cache(maxsize=32)
def _forward(task: Any) -> Any:
    """MJX's `forward` of a task's model, compiled: data, positions, velocities, other fields."""
    jax, mjx = load("jax", "fleet"), load("mujoco.mjx", "mjx")

    def forward(data: Any, q: Any, v: Any, fields: Any) -> Any:
        zero = 0.0 * data.qacc_warmstart
        return mjx.forward(
            task.mjx_model, data.replace(qpos=q, qvel=v, qacc_warmstart=zero, **fields)
        )

    return jax.jit(forward)


class Playground(StatePassingTestbed):
    """A task of MuJoCo Playground, ``"playground:CartpoleBalance"``, computed by MJX.

    Playground rounds the number of steps in a control period, so that a step that does not divide
    it runs at another decision rate without a word: here what is applied is read back, and refused
    where it is not what was asked. The integrator is the model's; another is set in the compiled
    model.

    Args:
        task: name in Playground's registry.
        success_return: see :class:`GymTestbed`.
        arguments: overrides of the task's configuration, but for its two periods.

    Raises:
        ModuleNotFoundError: without Playground, with the command that installs it.
        ValueError: for an unknown task.
    """

    choices = tuple(INTEGRATORS)

    def __init__(self, task: str, success_return: float | None = None, **arguments: Any) -> None:
        super().__init__(task, success_return, **arguments)
        check_versions("playground")
        self._registry = load("mujoco_playground", "playground").registry
        if task not in self._registry.ALL_ENVS:
            raise InputError(unknown_name("task of Playground", task, self._registry.ALL_ENVS))
        config = self._registry.get_default_config(task)
        own = without_stated(arguments)
        stock = self._make(None, config.sim_dt, config.ctrl_dt, **own)
        self.home = self.read(stock).discretization

    def build(self, discretization: Discretization, **arguments: Any) -> gym.Env[Any, Any]:
        """The task at its configured step and control period.

        Raises:
            ValueError: for a step that does not divide the control period, or a configuration that
                Playground does not take.
        """
        period, _ = split_period(self, discretization)
        return self._make(discretization.integrator, discretization.dt, period, **arguments)

    def read(self, env: gym.Env[Any, Any]) -> Applied:
        """From the compiled model, and from how often the task steps it."""
        task: Any = env.unwrapped.inner  # type: ignore[attr-defined]
        number, count = int(task.mjx_model.opt.integrator), task.n_substeps
        name = next((own for own, n in INTEGRATORS.items() if n == number), str(number))
        step = round_trip_step(task.mjx_model.opt.timestep)
        return Applied(Discretization(name, step, step * count, PLAYGROUND), count)

    def boundaries(self, environments: DiscretizedVectorEnv) -> PlaygroundBoundaries:
        """By MJX."""
        return PlaygroundBoundaries(environments.unwrapped.envs[0])  # type: ignore[attr-defined]

    def _make(
        self, integrator: str | None, dt: float, period: float, **arguments: Any
    ) -> gym.Env[Any, Any]:
        overrides = {"impl": "jax", **arguments, "sim_dt": dt, "ctrl_dt": period}
        key = integrator, json.dumps(overrides, sort_keys=True)
        if key not in self._tasks:
            task = self._tasks[key] = self._registry.load(self.task, config_overrides=overrides)
            if integrator is not None:
                mjx = load("mujoco.mjx", "mjx")
                task.mj_model.opt.integrator = INTEGRATORS[integrator]
                task._mjx_model = mjx.put_model(task.mj_model, impl=overrides["impl"])
        default = self._registry.get_default_config(self.task).episode_length
        length = arguments.get("episode_length", default)
        return TimeLimit(PlaygroundEnv(self.task, self._tasks[key]), length)


BRAX = "brax"
BACKENDS = ("generalized", "mjx", "positional", "spring")
DECISIONS = 1000
"""Of an episode, as Brax's own training has them."""


class BraxTask(StatePassingTestbed):
    """A task of Brax's, ``"brax:inverted_pendulum"``, whose integrators are Brax's backends.

    Choosing a backend changes what Brax's task is: its step, its steps per decision and, of some
    tasks, the gear of its motors. Step and decisions are set here, so that they are what is asked;
    the gear is the backend's.

    Args:
        task: its name.
        backend: whose step and control period are the home's.
        success_return: see :class:`GymTestbed`.
        arguments: of the task.

    Raises:
        ModuleNotFoundError: without Brax, with the command that installs it.
        ValueError: for an unknown task.
    """

    choices = BACKENDS

    def __init__(
        self,
        task: str,
        backend: str = "generalized",
        success_return: float | None = None,
        **arguments: Any,
    ) -> None:
        super().__init__(task, success_return, **arguments)
        check_versions("brax")
        self._envs = load("brax.envs", "brax")
        if task not in self._envs._envs:
            raise InputError(unknown_name("task of Brax", task, self._envs._envs))
        own = without_stated(arguments)
        stock = self._envs.get_environment(task, backend=backend, **own)
        self.home = self._applied(stock).discretization

    def build(self, discretization: Discretization, **arguments: Any) -> gym.Env[Any, Any]:
        """The task on a backend, with its step and its steps per decision.

        Raises:
            ValueError: for a step that does not divide the control period.
        """
        _, count = split_period(self, discretization)
        key = discretization.integrator, discretization.dt, count, json.dumps(arguments)
        if key not in self._tasks:
            chosen = {"backend": discretization.integrator, "n_frames": count}
            task = self._envs.get_environment(self.task, **chosen, **arguments)
            task.sys = task.sys.tree_replace({"opt.timestep": discretization.dt})
            self._tasks[key] = task
        return TimeLimit(StatePassing(self.task, self._tasks[key]), DECISIONS)

    def read(self, env: gym.Env[Any, Any]) -> Applied:
        """From the task's system and its steps per decision."""
        return self._applied(env.unwrapped.inner)  # type: ignore[attr-defined]

    def _applied(self, task: Any) -> Applied:
        step, count = round_trip_step(task.sys.opt.timestep), task._n_frames
        return Applied(Discretization(task._backend, step, step * count, BRAX), count)
