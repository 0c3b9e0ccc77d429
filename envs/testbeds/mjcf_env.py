"""Environments of a robot's model: its task, as Gymnasium's MuJoCo tasks are, and what is stepped.

Imported where one is made: its base class needs MuJoCo.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping
from dataclasses import replace
from operator import attrgetter
from typing import TYPE_CHECKING, Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from gymnasium.envs.mujoco import MujocoEnv

from integ_gym.support.errors import InputError

from ..environment import at_bounds
from ..foreign import FURTHER, ForeignPlant, ReturnGoal, part_names
from ..mujoco_ledger import Contacts
from ..ops.ops import Array
from ..rediscretized import RediscretizedEnv
from ..registries import ENGINES
from .making import ENGINE
from .mjcf import Memory, Robot, read_only
from .mjcf_engines import engine_of_model, integrators_of_model
from .mjcf_figures import Figures, OneOfOne
from .mjcf_model import describe_actuators, describe_skeleton

if TYPE_CHECKING:
    from .mjcf import MjcfTestbed


class Acting:
    """How a testbed decides and judges: about one robot, or many, whose arrays have lanes first.

    Attributes:
        testbed: what the robot sees and does.
        robot: the compiled model and its state.
        memory: see :class:`Memory`.
        command: what the episode is commanded.
        period: time between decisions, s.
        decisions: that have been taken in the episode.
        bounds: of actions.
        squares: sum over the decisions of the squared error of what is commanded, where a success
            asks for it.
    """

    testbed: MjcfTestbed
    robot: Robot
    memory: Memory
    command: Array
    period: float
    decisions: int
    bounds: tuple[Array, Array]
    squares: Any

    def decide(self, action: Any) -> Array:
        """Take an action and remember it; the controls of the actuators."""
        testbed, robot, memory = self.testbed, self.robot, self.memory
        low, high = self.bounds
        if np.shape(action)[-1:] != low.shape:
            raise InputError(
                f"an action of {testbed.title} must have shape {low.shape}, got {np.shape(action)}"
            )
        taken = read_only(np.minimum(np.maximum(np.asarray(action, np.float64), low), high))
        control = np.array(testbed.act(taken, robot), dtype=np.float64)  # may act much later
        wanted = (*taken.shape[:-1], robot.model.nu)
        if control.shape != wanted:
            raise InputError(
                f"`act` of {testbed.title} must give a control for each of the model's "
                f"{robot.model.nu} actuators, shape {wanted}, got shape {control.shape}"
            )
        memory.last_action = taken
        testbed.remember(memory, robot, self.command)
        self.decisions += 1
        memory.time = np.full(taken.shape[:-1], self.decisions * self.period)[()]
        return control

    def judge(self) -> tuple[Array, Any, Any]:
        """Observation, reward and falls where a control period has ended."""
        testbed, robot = self.testbed, self.robot
        if testbed.largest_error is not None:
            error = self.measure() - self.command
            self.squares = self.squares + np.vecdot(error, error)
        fallen = testbed.falls(robot)
        reward = testbed.reward(robot, self.memory, self.command)
        return self.see(), self.period * np.asarray(reward, np.float64), fallen

    def see(self) -> Array:
        """What is observed, as numbers."""
        seen = self.testbed.observe(self.robot, self.memory, self.command)
        lanes = self.command.shape[:-1]
        if isinstance(seen, Mapping):
            parts = [np.array(part, np.float64).reshape(*lanes, -1) for part in seen.values()]
            return np.concatenate(parts, axis=-1)
        return np.array(seen, dtype=np.float64).reshape(*lanes, -1)

    def measure(self) -> Array:
        """What is commanded as it is measured; empty where the testbed does not tell it."""
        measured = self.testbed.measure(self.robot)
        if measured is None:
            return np.zeros((*self.command.shape[:-1], 0))
        values = np.array(measured, dtype=np.float64)
        if values.shape != self.command.shape:
            raise InputError(
                f"`measure` of {self.testbed.title} must give a number for each of the "
                f"commands, shape {self.command.shape}, got shape {values.shape}"
            )
        return values


class MjcfTask(Acting, MujocoEnv):
    """A robot's task at one timestep and control period.

    Args:
        testbed: what the robot sees and does.
        dt: timestep, s.
        substeps: timesteps in a control period.
        render_mode: see Gymnasium's `MujocoEnv`.
    """

    action_space: Any
    """A `Box`."""

    def __init__(
        self, testbed: MjcfTestbed, dt: float, substeps: int, render_mode: str | None = None
    ) -> None:
        self.testbed, self.period = testbed, dt * substeps
        self._compiled = copy.copy(testbed.compiled.model)
        self._compiled.opt.timestep = dt
        modes = ["human", "rgb_array", "depth_array", "rgbd_tuple"]
        self.metadata = {"render_modes": modes, "render_fps": round(1.0 / self.period)}
        super().__init__(".", substeps, None, render_mode)  # a path that is there: none is read
        self.robot = Robot(self.model, self.data, testbed.keyframe)
        self._begin(np.random.default_rng(0))
        seen = testbed.observe(self.robot, self.memory, self.command)
        if isinstance(seen, Mapping):
            parts = {name: np.shape(part) for name, part in seen.items()}
            self.names_of_observation = part_names(parts)
        size = self._get_obs().shape
        self.observation_space = spaces.Box(-np.inf, np.inf, size, np.float64)

    @property
    def idle(self) -> tuple[Array, Array]:
        """The action and the controls before the first decision: zeros, and the keyframe's."""
        return np.zeros(self.action_space.shape), self.robot.key_ctrl

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Advance one control period."""
        self.do_simulation(self.decide(action), self.frame_skip)
        seen, reward, fallen = self.judge()
        if self.render_mode == "human":
            self.render()  # type: ignore[no-untyped-call]
        return seen, float(reward), bool(fallen), False, {"command": self.command.copy()}

    def reset_model(self) -> Array:
        """Start an episode, all of which is drawn by the environment's seed."""
        self._begin(self.np_random)
        return self._get_obs()

    def achieves(self) -> bool:
        """What the testbed says of an episode that lasts."""
        testbed = self.testbed
        most = math.inf if testbed.largest_error is None else testbed.largest_error
        follows = math.sqrt(self.squares / self.decisions) <= most
        return follows and bool(testbed.achieves(self.robot, self.memory, self.command))

    def _begin(self, rng: np.random.Generator) -> None:
        testbed, robot = self.testbed, self.robot
        robot.to_keyframe()
        start: Any = testbed.start
        if start(robot, rng) is not None:
            raise InputError(
                f"`start` of {testbed.title} must change `robot.data` in place, as in "
                "`robot.data.qvel[:] = …`, and return nothing"
            )
        self.command = read_only(np.asarray(testbed.draw_command(rng), dtype=np.float64))
        self.memory = Memory(last_action=read_only(np.zeros(self.action_space.shape)), time=0.0)
        self.decisions, self.squares = 0, 0.0
        self._forward()

    def _get_obs(self) -> Array:
        return self.see()

    def _get_reset_info(self) -> dict[str, Any]:
        return {"command": self.command.copy()}

    def _forward(self) -> None:
        """Compute sensors and sites of the state as it is; the next step is as without this."""
        from mujoco import mj_forward

        mj_forward(self.model, self.data)

    def _initialize_simulation(self) -> tuple[Any, Any]:
        from mujoco import MjData

        view = self._compiled.vis.global_
        view.offwidth = max(view.offwidth, self.width)
        view.offheight = max(view.offheight, self.height)
        return self._compiled, MjData(self._compiled)

    def _set_action_space(self) -> Any:
        own = self.testbed
        size = self.model.nu if own.actions is None else own.actions
        low, high = own.action_bounds
        self.action_space = space = spaces.Box(low, high, (size,), np.float32)
        self.bounds = space.low.astype(np.float64), space.high.astype(np.float64)
        return self.action_space


class MjcfEnv(RediscretizedEnv):
    """A robot's environment in a discretization.

    Commands are delayed as the controls that :meth:`MjcfTestbed.act` made of them at their
    decision. What evidence tells as applied is the action whose controls act.
    """

    _inner: MjcfTask
    mujoco = property(attrgetter("_mujoco"))
    model = property(attrgetter("_model"))
    ledger = property(attrgetter("_ledger"))
    figures = property(attrgetter("_figures"))
    goal = property(attrgetter("_goal"))
    silence = property(attrgetter("_silence"))
    command_ends = property(attrgetter("_command_ends"))
    control_entries = property(attrgetter("_control_entries"))

    def __init__(
        self, env: gym.Env[Any, Any], integrator: str, engine: str = ENGINE, **stated: Any
    ) -> None:
        super().__init__(env, integrator=integrators_of_model(engine)[integrator], **stated)
        if engine != ENGINE:
            own, kind = self.setup, ENGINES.load(engine)
            steps = engine_of_model(engine, self._model, self._inner.testbed.compiled)
            self._ledger.take_step_by(steps.advance)
            self.setup = replace(
                own,
                settings=replace(own.settings, engine=engine, integrator=integrator),
                engine=replace(
                    own.engine,
                    package=kind.package,
                    width=int(kind.width),
                    reports=steps.reports,
                ),
                fingerprinted=None,
            )

    @property
    def steps_alone(self) -> bool:
        """Whether a control period is steps by `mj_step` of its state, under one command."""
        plain = hasattr(self._mujoco, "mj_makeM") and not self._model.nplugin
        plain = plain and self.setup.settings.engine == ENGINE and not self._inner.render_mode
        return plain and not self._split and not self._ledger.staged

    @property
    def start(self) -> tuple[float, Array]:
        """Energy of the state, J, and the command, where an episode has begun."""
        return self._energy, self._control

    @property
    def command_bounds(self) -> tuple[Array, Array]:
        """Least and most of an action."""
        return self._command_low, self._command_high

    @property
    def needless_sensors(self) -> int:
        """The flag that leaves sensors out of a step; 0 where later ones depend on them."""
        has_history = getattr(self._model, "nhistory", 0) or self._model.nplugin
        return 0 if has_history else int(getattr(self._mujoco.mjtDisableBit, "mjDSBL_SENSOR", 0))

    def _make_goal(self, success_return: float | None) -> ReturnGoal:
        return RobotGoal(success_return, self._inner)

    def _idle_command(self) -> Any:
        return self._inner.idle

    def _describe_plant(self) -> ForeignPlant:
        plant, size = super()._describe_plant(), len(self._command_low)
        names = actuators = [name.removesuffix("_control") for name, _ in plant.controls]
        if size != len(names):
            names = [f"action{index}" for index in range(size)]
        controls = tuple((f"{name}_action", "1") for name in names)
        testbed, is_measured = self._inner.testbed, self._inner.measure().size > 0
        if testbed.largest_error is not None and not is_measured:
            raise InputError(f"`largest_error` of {testbed.title} asks for its `measure`; give it")
        self._figures = Figures(self._mujoco, self._model, testbed.commands, is_measured, actuators)
        self._contacts, further = Contacts(self._data), self._figures.columns
        return replace(plant, name=testbed.title, controls=controls, further=further)

    def _describe_model(self) -> dict[str, Any]:
        return {
            "model_sha256": self._inner.testbed.compiled.sha256,
            "actuators": describe_actuators(self._mujoco, self._model),
            "skeleton": describe_skeleton(
                self._mujoco, self._model, super()._describe_plant().coordinates
            ),
        }

    def _info(self, *values: Any) -> dict[str, Any]:
        inner = self._inner
        robots, looks = OneOfOne(self._data), [self._figures.look(self._contacts)]
        told_of = inner.command[None], inner.measure()[None]
        (figures,) = self._figures.read(looks, robots, *told_of)
        return {**super()._info(*values), FURTHER: figures}

    def _command_bounds(self) -> tuple[Array, Array]:
        space: Any = self.action_space
        return space.low.astype(np.float64), space.high.astype(np.float64)

    def _take_command(self, control: Array) -> None:
        action = self._inner.memory.last_action
        timing, order = self.setup.timing, (action, control)
        late = timing.latency or timing.drawn
        self._orders = self._queue.give(order) if late else [(order, timing.substeps)]
        (self._applied, _), _ = self._orders[-1]
        self._saturated = at_bounds(action, self._command_ends)

    def _segments(self, control: Array) -> list[tuple[Array, int]]:
        return [(acting, steps) for (_, acting), steps in self._orders]

    def _order(self, action: Any) -> Any:
        return action  # whose controls are delayed

    def _finish_period(self) -> None:
        self._mujoco.mj_forward(self._model, self._data)

    def _compute_energy(self) -> float:
        return self._ledger.energy(self._data, computed=True)


class RobotGoal(ReturnGoal):
    """Success by lasting without a fall and what the robot achieves besides, or by a return.

    Args:
        wanted: the return that is a success; None: lasting is.
        task: the robot's.
    """

    def __init__(self, wanted: float | None, task: MjcfTask) -> None:
        super().__init__(wanted)
        self._task = task

    @property
    def words(self) -> str:
        """What success is."""
        if self._wanted is not None:
            return super().words
        own = self._task.testbed
        lasting = f"no fall within `duration` ({own.fall})" if own.fall else super().words
        error = (
            "" if own.largest_error is None else f"a command error of at most {own.largest_error:g}"
        )
        return ", and ".join(filter(None, (lasting, error, own.achievement)))

    def note(self, reward: float, terminated: bool, truncated: bool, time: float) -> bool:
        """Take in a step that ends at ``time``, s; whether the episode has ended in success."""
        succeeded = super().note(reward, terminated, truncated, time)
        return succeeded and (self._wanted is not None or self._task.achieves())
