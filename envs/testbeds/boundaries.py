"""What an environment does with a state and an action before it integrates."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from math import prod
from typing import Any, ClassVar, NamedTuple

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from integ_gym.support.optional import load

from ..foreign import wrappers_of
from ..lanes import DiscretizedVectorEnv
from ..ops.ops import SCALAR, join_state
from ..rediscretized import integrator_numbers, plant_of
from ..tasks.interface import to_public_order

Array = NDArray[np.float64]

Named = dict[str, float]
"""Values by the names of their components, in order."""

ACTUATORS = "command of the actuators"
"""What a command is where it is recorded as it reaches the actuators, within their limits."""


class Scheme(NamedTuple):
    """What a compiled model is stepped by.

    Attributes:
        engine: its name.
        integrator: its name, the same in all engines of one model.
        dt: step, s.
    """

    engine: str
    integrator: str
    dt: float


class Boundaries:
    """What one environment makes of states and actions, at four boundaries before it integrates.

    Engines that step one compiled model also say what constraints do, and what one step changes.

    A method that returns None cannot say, and that boundary is not compared. This base says what is
    observed at a start and which action reaches the environment inside all wrappers; your own
    testbed states more in a subclass, which its ``boundaries`` returns.

    Args:
        env: one environment, or a vector environment whose first lane is meant.

    Attributes:
        coordinates: names of the positions that make a state; empty: it cannot be put into one.
        velocities: names of the velocities, likewise.
        commands: what a command is; commands of different kinds are not compared.
        width: bits of the floats that it computes with.
        scheme: what steps its compiled model; None: constraints and steps are not compared.
    """

    coordinates: tuple[str, ...] = ()
    velocities: tuple[str, ...] = ()
    commands: ClassVar[str] = "action of the environment inside"
    width: int = 64
    scheme: Scheme | None = None

    def __init__(self, env: Any) -> None:
        self.env = env
        for wrapper in wrappers_of(env):
            if hasattr(wrapper, "update_running_mean"):  # else it shows what went before, too
                wrapper.update_running_mean = False

    @property
    def action_space(self) -> gym.spaces.Space[Any]:
        """Of one environment."""
        return self.env.action_space  # type: ignore[no-any-return]

    @property
    def state(self) -> Array:
        """Positions, then velocities, SI units; empty where it cannot be put into a state."""
        return np.zeros(0)

    def start(self, seed: int) -> Any:
        """Begin an episode; the first observation."""
        return self.env.reset(seed=seed)[0]

    def advance(self, action: Any) -> bool:
        """Take one decision; whether the episode goes on."""
        *_, terminated, truncated, _ = self.env.step(action)
        return not (terminated or truncated)

    def observation(self, state: Array, seed: int) -> Named | None:
        """What is observed in a state, or, where it cannot be put into one, at a seed's start."""
        return number_components("obs", self.start(seed))

    def command(self, state: Array, action: Any) -> Named | None:
        """The actuators' command."""
        reached = intercept(lambda: self.env.step(action), self.env.unwrapped, "step")
        return None if reached is None else number_components("action", reached)

    def force(self, state: Array, command: Array) -> Named | None:
        """The generalized force that a command makes, by coordinate."""
        return None

    def acceleration(self, state: Array, force: Array) -> Named | None:
        """Accelerations under a generalized force, at once: before any step, by coordinate."""
        return None

    def constraint(self, state: Array, force: Array) -> Named | None:
        """The generalized force of constraints under a generalized force, by coordinate."""
        return None

    def step(self, state: Array, given: tuple[Array, Scheme]) -> Named | None:
        """Change of velocity in one step, by coordinate.

        Args:
            state: at its beginning.
            given: the generalized force, and the integrator and dt that it is made by.
        """
        return None


class _Reached(Exception):
    """What was intercepted is on its way out."""


def intercept(run: Callable[[], Any], owner: Any, name: str, argument: int = 0) -> Any:
    """The argument with which a function inside is called first, which is not run; or None.

    Args:
        run: leads to that call.
        owner: object or module whose function it is.
        name: of the function.
        argument: its place among the arguments.
    """

    def catch(*given: Any) -> Any:
        raise _Reached(given[argument])

    held = vars(owner).get(name)
    setattr(owner, name, catch)
    try:
        run()
    except _Reached as reached:
        return reached.args[0]
    finally:
        if held is None:
            delattr(owner, name)
        else:
            setattr(owner, name, held)
    return None


def number_components(name: str, values: Any) -> Named:
    flat = np.asarray(values, np.float64).ravel().tolist()
    return {f"{name}{k}": value for k, value in enumerate(flat)}


def name_components(names: Sequence[str], values: Any) -> Named:
    return dict(zip(names, np.asarray(values, np.float64).ravel().tolist(), strict=True))


class IntegBoundaries(Boundaries):
    """Of an environment of integ-gym's, whose engine may give accelerations or a step alone.

    Args:
        environments: whose first lane is meant.
    """

    commands: ClassVar[str] = ACTUATORS

    def __init__(self, environments: DiscretizedVectorEnv) -> None:
        super().__init__(environments)
        self._setup = setup = environments.setups[0]
        plant = setup.plant
        self.coordinates, self.velocities = plant.coordinates, plant.velocities
        self.width = int(setup.engine.width)

    @property
    def action_space(self) -> gym.spaces.Space[Any]:
        """Of one lane."""
        return self.env.single_action_space  # type: ignore[no-any-return]

    @property
    def state(self) -> Array:
        """Of the first lane."""
        both = np.array([np.ravel(x)[0] for x in self.env.state_components], np.float64)
        return np.concatenate([both[0::2], both[1::2]])

    def start(self, seed: int) -> Any:
        """Begin an episode in every lane."""
        return self.env.reset(seed=[seed] * self.env.num_envs)[0]

    def advance(self, action: Any) -> bool:
        """Take one decision in every lane."""
        *_, terminated, truncated, _ = self.env.step(np.array([action] * self.env.num_envs))
        return not (terminated[0] or truncated[0])

    def observation(self, state: Array, seed: int) -> Named:
        """As an episode that starts there shows it, with the sensor noise of a seed."""
        start = np.array([join_state(*self._parts(state))] * self.env.num_envs)
        start = to_public_order(self._setup.task, start)
        shown, _ = self.env.reset(seed=[seed] * self.env.num_envs, options={"state": start})
        return name_components(self._setup.task.observation_names, shown[0])

    def command(self, state: Array, action: Any) -> Named:
        """The controls within their limits."""
        asked = self._setup.task.command(SCALAR, tuple(np.ravel(action).astype(float).tolist()))
        names = (name for name, _ in self._setup.plant.controls)
        return dict(zip(names, map(float, asked.controls), strict=True))

    def force(self, state: Array, command: Array) -> Named:
        """Of the controls, along the coordinates."""
        system, controls = self._setup.system, tuple(command.tolist())
        if system.sampler is not None:
            controls = system.sampler.efforts(SCALAR, *self._parts(state), controls)
        force = system.forces(SCALAR, *self._parts(state), controls)
        return name_components(self.coordinates, force)

    def acceleration(self, state: Array, force: Array) -> Named | None:
        """The engine's; None where it gives a step alone."""
        find = getattr(self._setup.engine, "acceleration", None)
        found = None if find is None else find(*self._parts(state), tuple(force.tolist()))
        return None if found is None else name_components(self.coordinates, found)

    def _parts(self, state: Array) -> tuple[tuple[float, ...], tuple[float, ...]]:
        count = len(self.coordinates)
        return tuple(state[:count].tolist()), tuple(state[count:].tolist())


class MujocoBoundaries(Boundaries):
    """Of a task of Gymnasium's MuJoCo environments: all four, by MuJoCo's own functions.

    Contact is in the acceleration, as MuJoCo's solver has it from no guess. The integrator
    `discrete`, whose `mj_forward` looks ahead by a step, is put aside for it.

    Args:
        env: with such a task inside all wrappers.
    """

    commands: ClassVar[str] = ACTUATORS

    def __init__(self, env: gym.Env[Any, Any]) -> None:
        super().__init__(env)
        self._mujoco = mujoco = load("mujoco", "mujoco")
        inner: Any = env.unwrapped
        self._inner, self._model, self._data = inner, inner.model, inner.data
        plant = plant_of(mujoco, self._model, "")
        self.coordinates, self.velocities = plant.coordinates, plant.velocities
        self._axes = [name.removesuffix("_dot") for name in plant.velocities]
        self._actuators = [name.removesuffix("_control") for name, _ in plant.controls]

    @property
    def state(self) -> Array:
        """Of MuJoCo's data."""
        return np.concatenate([self._data.qpos, self._data.qvel])

    def observation(self, state: Array, seed: int) -> Named | None:
        """What the task and the wrappers that change observations make of it."""
        if not hasattr(self._inner, "_get_obs"):
            return None
        self._place(state)
        shown = self._inner._get_obs()
        for one in reversed(list(wrappers_of(self.env))):
            if isinstance(one, gym.ObservationWrapper):
                shown = one.observation(shown)
        names = self._observed()
        return (
            name_components(names, shown)
            if len(names) == np.size(shown)
            else number_components("obs", shown)
        )

    def command(self, state: Array, action: Any) -> Named | None:
        """The task's command to the actuators, within their limits."""
        self._place(state)
        passed = intercept(lambda: self.env.step(action), self._inner, "do_simulation")
        if passed is None or np.size(passed) != self._model.nu:
            return None
        model, disabled = self._model, self._mujoco.mjtDisableBit.mjDSBL_CLAMPCTRL
        limited = model.actuator_ctrllimited.astype(bool)
        limited &= not model.opt.disableflags & int(disabled)
        bounded = np.clip(np.ravel(passed), *model.actuator_ctrlrange.T)
        return name_components(self._actuators, np.where(limited, bounded, np.ravel(passed)))

    def force(self, state: Array, command: Array) -> Named | None:
        """`qfrc_actuator`."""
        if len(command) != self._model.nu:
            return None
        self._place(state, ctrl=command)
        return name_components(self._axes, self._data.qfrc_actuator)

    def acceleration(self, state: Array, force: Array) -> Named | None:
        """`qacc` with the actuators off and the force applied."""
        if len(force) != self._model.nv:
            return None
        option, off = self._model.opt, int(self._mujoco.mjtDisableBit.mjDSBL_ACTUATION)
        flags, integrator = option.disableflags, option.integrator
        option.disableflags, option.integrator = flags | off, integrator_numbers()["Euler"]
        self._place(state, qfrc_applied=force)
        option.disableflags, option.integrator = flags, integrator
        return name_components(self._axes, self._data.qacc)

    def _place(self, state: Array, **inputs: Array) -> None:
        """Put the model into a state with nothing left of what went before."""
        mujoco, model, data = self._mujoco, self._model, self._data
        mujoco.mj_resetData(model, data)
        data.qpos[:], data.qvel[:] = state[: model.nq], state[model.nq :]
        for name, values in inputs.items():
            getattr(data, name)[:] = values
        mujoco.mj_forward(model, data)
        mujoco.mj_rnePostConstraint(model, data)

    def _observed(self) -> list[str]:
        """Names of what the task observes, where Gymnasium says what that is made of."""
        parts: Mapping[str, Any] = getattr(self._inner, "observation_structure", {})
        names: list[str] = []
        for part, size in parts.items():
            if part.startswith("skipped"):
                continue
            known = {"qpos": self.coordinates, "qvel": self.velocities}.get(part, ())
            own = [f"{part}{k}" for k in range(int(prod(np.atleast_1d(size))))]
            names += known[-len(own) :] if own and len(known) >= len(own) else own
        return names
