"""Testbeds of one's own robots: a model of MuJoCo's, and what a policy sees and does."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property
from inspect import Parameter, signature
from math import ceil
from types import SimpleNamespace
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.envs.registration import EnvSpec
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers import TimeLimit

from integ_gym.support.errors import InputError
from integ_gym.support.optional import load
from integ_gym.support.parameters import positive, unknown_name

from ..lanes import DiscretizedVectorEnv
from ..ops.ops import Array
from ..rediscretized import RediscretizedEnv, integrator_of
from ..settings import DELAYS, TOLERANCE, Discretization
from .boundaries import Boundaries
from .gym_testbed import Applied, Success, class_path, split_period, without_stated
from .making import ENGINE, MujocoTestbed
from .mjcf_engines import MODEL_ENGINES, ModelBoundaries, integrators_of_model
from .mjcf_model import CompiledModel, compile_model, compile_sensing

TOGETHER = 64
"""Most robots that act together; for so many is a graph's batch probed."""


def read_only(values: Array) -> Array:
    """A copy that cannot be changed: what a robot's methods are given outlives their call."""
    held = values.copy()
    held.setflags(write=False)
    return held


class Robot:
    """A compiled model and its state, by the names of its file.

    Attributes:
        model: MuJoCo's `MjModel`.
        data: its `MjData`; sensors and sites are those of the state.
        key_qpos: joint positions of the keyframe, shape (nq,).
        key_ctrl: its controls, shape (nu,).
    """

    def __init__(self, model: Any, data: Any, keyframe: str | None) -> None:
        self.model, self.data = model, data
        mujoco = load("mujoco", "mujoco")
        names = [model.key(index).name for index in range(model.nkey)]
        if keyframe is not None and keyframe not in names:
            raise InputError(unknown_name("keyframe of the model", keyframe, names))
        self._key = None if keyframe is None else names.index(keyframe)
        on_joint = model.actuator_trntype == int(mujoco.mjtTrn.mjTRN_JOINT)
        driven = np.unique(model.actuator_trnid[on_joint, 0])
        self._positions, self._velocities = model.jnt_qposadr[driven], model.jnt_dofadr[driven]
        ends = model.sensor_adr + model.sensor_dim
        self._sensors = {
            model.sensor(index).name: slice(int(model.sensor_adr[index]), int(ends[index]))
            for index in range(model.nsensor)
        }
        self._sites = {model.site(index).name: index for index in range(model.nsite)}
        self.to_keyframe()
        self.key_qpos, self.key_ctrl = read_only(data.qpos), read_only(data.ctrl)

    def to_keyframe(self) -> None:
        """Put it into its keyframe; without one, into the model's reference pose."""
        mujoco = load("mujoco", "mujoco")
        if self._key is None:
            mujoco.mj_resetData(self.model, self.data)
        else:
            mujoco.mj_resetDataKeyframe(self.model, self.data, self._key)

    @property
    def joint_angles(self) -> Array:
        """Positions of the joints that have actuators, in the model's order, rad or m."""
        angles: Array = self.data.qpos.take(self._positions, axis=-1)
        return angles

    @property
    def home_angles(self) -> Array:
        """The same in the keyframe."""
        angles: Array = self.key_qpos.take(self._positions)
        return angles

    @property
    def joint_velocities(self) -> Array:
        """Velocities of these joints, rad/s or m/s."""
        velocities: Array = self.data.qvel.take(self._velocities, axis=-1)
        return velocities

    def sensor(self, name: str) -> Array:
        """What a sensor reads.

        Raises:
            ValueError: for a name that the model does not have.
        """
        if name not in self._sensors:
            raise InputError(unknown_name("sensor of the model", name, self._sensors))
        reading: Array = self.data.sensordata[..., self._sensors[name]]
        return reading.copy()

    def gravity(self, site: str) -> Array:
        """Direction of gravity in the frame of a site: (0, 0, -1) where it is upright.

        Raises:
            ValueError: for a name that the model does not have.
        """
        if site not in self._sites:
            raise InputError(unknown_name("site of the model", site, self._sites))
        direction: Array = -self.data.site_xmat[..., self._sites[site], 6:9]
        return direction


class Memory(SimpleNamespace):
    """What an environment keeps between the decisions of an episode; a robot adds its own.

    Attributes:
        last_action: of the decision before, zeros at first.
        time: of the last decision, s.
    """

    last_action: Array
    time: Any


def model_arguments(arguments: Mapping[str, Any]) -> dict[str, Any]:
    """Of a robot's arguments, those that its model is made with."""
    every = ("duration", "solver")
    return {name: x for name, x in without_stated(arguments).items() if name not in every}


def stock_arguments(testbed: Any) -> dict[str, Any]:
    """Arguments of a testbed of one's own, but the defaults of its code where it has them."""
    own = model_arguments(testbed.arguments)
    make = getattr(testbed, "model", None) or getattr(testbed, "build", None)
    known = signature(make).parameters if make else {}
    defaults = {name: known[name].default for name in own if name in known}
    return own | {name: x for name, x in defaults.items() if x is not Parameter.empty}


class MjcfTestbed(MujocoTestbed):
    """Base class of your own robot's testbed: a model file, what a policy sees, and what it does.

    The robot's home is what the file says: integrator, timestep, solver, cone and flags. In any
    other discretization the same model is stepped. :attr:`control_period`, :meth:`model`,
    :meth:`observe` and :meth:`act` must be given; the rest may be.

    Args:
        arguments: those of :meth:`model`, JSON-serialisable; ``success_return``, from which on an
            episode succeeds (None: see :attr:`success`); ``duration`` of an episode, s, and
            ``solver``, MuJoCo's settings, in place of the class's and the file's; the delays that
            every testbed takes.

    Attributes:
        control_period: time between two decisions at home, s.
        keyframe: name of the pose that episodes start in; None: the model's reference pose.
        duration: of an episode, s.
        actions: numbers in an action; None: one for each actuator.
        action_bounds: least and most of every one of them; what is beyond is clipped and counted.
        commands: name of each number in an episode's command, with its least and largest value.
        fall: what a fall is, in words.
        achievement: what else a success asks for, in words; see :meth:`achieves`.
        largest_error: most that an episode that succeeds may miss: the root mean square over it of
            :meth:`measure` minus the command, as a vector, SI units; None: any.
        together: whether :meth:`observe`, :meth:`act`, :meth:`measure`, :meth:`remember`,
            :meth:`reward` and :meth:`falls` take many robots at once, as NumPy does: what they are
            given and give then has robots first, as of shape (robots, n). With many starts this is
            several times as fast.

    >>> import integ_gym
    >>> class Balance(integ_gym.MjcfTestbed):
    ...     control_period = 0.02
    ...     fall = "the pole tips by more than 0.2 rad"
    ...
    ...     def model(self):
    ...         from gymnasium.envs.mujoco import mujoco_env
    ...
    ...         return mujoco_env.expand_model_path("inverted_pendulum.xml")
    ...
    ...     def observe(self, robot, memory, command):
    ...         return [*robot.data.qpos, *robot.data.qvel]
    ...
    ...     def act(self, action, robot):
    ...         return 3.0 * action
    ...
    ...     def falls(self, robot):
    ...         return abs(robot.data.joint("hinge").qpos[0]) > 0.2
    >>> Balance().home
    Discretization(integrator='RK4', dt=0.02, control_period=0.02, engine='mujoco')
    """

    control_period: float
    keyframe: str | None = None
    duration: float = 10.0
    actions: int | None = None
    action_bounds: tuple[float, float] = (-1.0, 1.0)
    commands: Mapping[str, tuple[float, float]] = {}
    fall: str = ""
    achievement: str = ""
    largest_error: float | None = None
    together: bool = False

    def __init__(self, **arguments: Any) -> None:
        super().__init__(type(self).__name__, **arguments)

    def model(self, **arguments: Any) -> Any:
        """Path of the MJCF file, or a `mujoco.MjSpec`."""
        raise NotImplementedError(f"{self.title} must define `model`")

    def observe(self, robot: Robot, memory: Memory, command: Array) -> Any:
        """What a policy sees at a decision: numbers in its order, or a dictionary of parts."""
        raise NotImplementedError(f"{self.title} must define `observe`")

    def act(self, action: Array, robot: Robot) -> Any:
        """The controls of the actuators that an action means, shape (nu,)."""
        raise NotImplementedError(f"{self.title} must define `act`")

    def start(self, robot: Robot, rng: np.random.Generator) -> None:
        """Change the keyframe, in which ``robot`` is, into the start of an episode."""

    def draw_command(self, rng: np.random.Generator) -> Array:
        """What an episode is commanded, drawn evenly between the bounds of :attr:`commands`."""
        return np.array([rng.uniform(low, high) for low, high in self.commands.values()])

    def measure(self, robot: Robot) -> Any:
        """Present values of what is commanded, ordered as :attr:`commands`; None: not measured."""
        return None

    def remember(self, memory: Memory, robot: Robot, command: Array) -> None:
        """Keep something of a decision, of which ``memory.last_action`` is the action."""

    def reward(self, robot: Robot, memory: Memory, command: Array) -> float:
        """Reward per second at the end of a control period."""
        return 1.0

    def falls(self, robot: Robot) -> bool:
        """Whether it has fallen, which ends the episode."""
        return False

    def achieves(self, robot: Robot, memory: Memory, command: Array) -> bool:
        """Whether an episode that has lasted without a fall is a success."""
        return True

    @cached_property
    def compiled(self) -> CompiledModel:
        """The model, and its file's hash."""
        own = model_arguments(self.arguments)
        try:
            signature(self.model).bind(**own)
        except TypeError as error:
            raise InputError(
                f"{self.title} is made with the arguments of its `model`"
                f"{signature(self.model)}: {error}; a command states them by --env-arg NAME=VALUE"
            ) from error
        return compile_model(self.model(**own))

    @cached_property
    def sensing(self) -> Any:
        """See :func:`.mjcf_model.compile_sensing`."""
        return compile_sensing(self.model(**model_arguments(self.arguments)))

    @property
    def home(self) -> Discretization:
        """Integrator and timestep of the file, and the control period."""
        model = self.compiled.model
        if isinstance(getattr(type(self), "control_period", None), property):
            raise InputError(f"{self.title} must say its `control_period`, s")
        step = float(model.opt.timestep)
        return Discretization(integrator_of(model), step, float(self.control_period), ENGINE)

    @property
    def engines(self) -> tuple[str, ...]:
        """C MuJoCo and the engines that step its models."""
        return (ENGINE, *MODEL_ENGINES)

    def integrators(self, engine: str) -> tuple[str, ...]:
        """Those of an engine that step a compiled model, by its own names."""
        if engine not in self.engines:
            raise InputError(unknown_name(f"engine of {self.title}", engine, self.engines))
        return tuple(integrators_of_model(engine))

    @property
    def success(self) -> Success:
        """No fall for as long as an episode lasts, and what the robot says besides."""
        return Success(self._setup.task.goal, "success_return")

    def environment(self, render_mode: str | None = None, **arguments: Any) -> RediscretizedEnv:
        """A Gymnasium environment of the robot at home.

        Args:
            render_mode: ``"rgb_array"``, ``"human"`` or None.
            arguments: that differ from the testbed's.
        """
        return self.lane(self.home, {**self.arguments, **arguments}, render_mode)

    @cached_property
    def _setup(self) -> Any:
        env = self.environment()
        env.close()
        return env.setup

    def lane(
        self,
        discretization: Discretization,
        arguments: dict[str, Any],
        render_mode: str | None = None,
    ) -> RediscretizedEnv:
        """The robot in a discretization.

        Raises:
            ValueError: for an integrator or step that it cannot have.
        """
        from .mjcf_env import MjcfEnv, MjcfTask

        own, given = without_stated(arguments), without_stated(self.arguments)
        if own != given:
            return type(self)(**arguments).lane(discretization, arguments, render_mode)
        period, count = split_period(self, discretization)
        duration = float(arguments.get("duration", self.duration))
        if fault := positive(duration):
            raise InputError(f"`duration` {fault}, got {duration!r}")
        task: gym.Env[Any, Any] = MjcfTask(self, discretization.dt, count, render_mode)
        limit = max(1, ceil(duration / period * (1.0 - TOLERANCE)))
        own.pop("solver", None)

        def make(render_mode: str | None = None, **own: Any) -> gym.Env[Any, Any]:
            return MjcfTask(type(self)(**own), discretization.dt, count, render_mode)

        path = class_path(type(self))  # by which evidence finds it again
        task.spec = EnvSpec(path, make, max_episode_steps=limit, kwargs=own)
        stated = {name: arguments.get(name) for name in ("success_return", "solver", *DELAYS)}
        own_name, engine = discretization.integrator, discretization.engine
        if own_name not in self.integrators(engine):
            kind = f"integrator of {engine} for {self.title}"
            raise InputError(unknown_name(kind, own_name, self.integrators(engine)))
        return MjcfEnv(TimeLimit(task, limit), own_name, engine, **stated)

    def room(
        self, discretization: Discretization, arguments: Mapping[str, Any], policies: int
    ) -> int:
        """Most starts of each policy that are evaluated at once: many, where they are together."""
        alone = discretization.engine != ENGINE or any(arguments.get(name) for name in DELAYS)
        return max(1, (TOGETHER if self.together and not alone else self.side_by_side) // policies)

    def join(self, make: Any, lanes: int, autoreset_mode: Any) -> DiscretizedVectorEnv:
        """Robots that act together, where they can."""
        from .mjcf_lanes import RobotLanes

        if self.together and AutoresetMode(autoreset_mode) is AutoresetMode.DISABLED:
            first = make()
            if first.steps_alone:
                return RobotLanes(lambda: first, lanes, autoreset_mode)
        return super().join(make, lanes, autoreset_mode)

    def applied(self, environments: DiscretizedVectorEnv) -> Applied:
        """From the compiled model of the first lane, by its engine's names."""
        found = super().applied(environments)
        (setup,) = environments.setups
        engine, step = setup.settings.engine, found.discretization
        names = {theirs: own for own, theirs in integrators_of_model(engine).items()}
        own = replace(step, engine=engine, integrator=names[step.integrator])
        return replace(found, discretization=own)

    def boundaries(self, environments: DiscretizedVectorEnv) -> Boundaries:
        """By the engine's own functions."""
        (setup,) = environments.setups
        env = environments.unwrapped.envs[0]  # type: ignore[attr-defined]
        return ModelBoundaries(env, setup.settings.engine)
