"""An environment whose library runs in another process, and the testbed of such environments."""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar
from weakref import WeakValueDictionary

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from gymnasium.envs.registration import EnvSpec
from gymnasium.wrappers import TimeLimit
from numpy.typing import NDArray

from integ_gym.support.isolated import ISOLATED, IsolatedEnvironment, Worker

from ..lanes import DiscretizedVectorEnv
from ..settings import Discretization
from .boundaries import ACTUATORS, Boundaries, Named, name_components, number_components
from .gym_testbed import Applied, GymTestbed, split_period, without_stated

STARTING = 900.0
"""Time in which a library is imported and a task made, its programs compiled, s."""


class RemoteEnv(gym.Env[NDArray[np.float64], NDArray[np.float32]]):
    """One lane of a task in another process; a time limit is another's business.

    Args:
        title: what it is called.
        worker: serves the task.
        lane: its number, the size of an observation, the bounds of actions.
    """

    def __init__(self, title: str, worker: Worker, lane: Mapping[str, Any]) -> None:
        self.title, self.worker = title, worker
        self.lane = int(lane["lane"])
        self.spec = EnvSpec(f"{title}-v0")
        low, high = (np.array(lane[name], np.float32) for name in ("low", "high"))
        self.action_space = spaces.Box(low, high)
        self.observation_space = spaces.Box(-np.inf, np.inf, (lane["observations"],), np.float64)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float64], dict[str, Any]]:
        """Start an episode, drawn there from a number that is drawn here."""
        super().reset(seed=seed)
        drawn = int(self.np_random.integers(2**31))
        return np.array(self.worker.call("reset", lane=self.lane, seed=drawn)), {}

    def step(
        self, action: NDArray[np.float32]
    ) -> tuple[NDArray[np.float64], float, bool, bool, dict[str, Any]]:
        """Advance one decision."""
        given = np.asarray(action, np.float64).ravel().tolist()
        answer, reward, terminated = self.worker.call("step", lane=self.lane, action=given)
        return np.array(answer), float(reward), bool(terminated), False, {}


class RemoteTestbed(GymTestbed):
    """A task of a library that runs in a Python environment of its own.

    One process serves all lanes of a discretization, and ends with the last of them.

    Args:
        task: its name there.
        success_return: see :class:`GymTestbed`.
        arguments: of the task.
    """

    apart: ClassVar[IsolatedEnvironment]
    """The environment."""
    served: ClassVar[Path]
    """File that the process serves."""

    def __init__(self, task: str, success_return: float | None = None, **arguments: Any) -> None:
        super().__init__(success_return, **arguments)
        self.task = self.title = task
        self.registered = EnvSpec(f"{task}-v0")
        self._workers: WeakValueDictionary[str, Worker] = WeakValueDictionary()

    @cached_property
    def home(self) -> Discretization:  # type: ignore[override]
        """What the task is by itself.

        Raises:
            ModuleNotFoundError: without the library's environment, with what sets it up.
            ValueError: for an unknown task.
        """
        given = without_stated(self.arguments)
        worker = self.apart.start(self.served)
        answer = worker.call("home", STARTING, task=self.task, arguments=given)
        return Discretization(**answer, engine=self.apart.name)

    def build(self, discretization: Discretization, **arguments: Any) -> gym.Env[Any, Any]:
        """A lane in a discretization.

        Raises:
            ValueError: for a step that does not divide the control period.
        """
        period, _ = split_period(self, discretization)
        given = {
            "task": self.task, "integrator": discretization.integrator, "dt": discretization.dt,
            "control_period": period, "arguments": arguments,
        }  # fmt: skip
        key = json.dumps(given, sort_keys=True)
        worker = self._workers.get(key)
        if worker is None:
            worker = self._workers[key] = self.apart.start(self.served)
        lane = worker.call("make", STARTING, **given)
        return TimeLimit(RemoteEnv(self.title, worker, lane), lane["decisions"])

    def read(self, env: gym.Env[Any, Any]) -> Applied:
        """From the lane itself."""
        lane: Any = env.unwrapped
        answer = lane.worker.call("applied", lane=lane.lane)
        count = answer.pop("substeps")
        return Applied(Discretization(**answer, engine=self.apart.name), count)


class DmControlBoundaries(Boundaries):
    """Of a task of dm_control's suite: all four, by its own MuJoCo.

    Args:
        env: with a :class:`RemoteEnv` inside all wrappers.
    """

    commands: ClassVar[str] = ACTUATORS

    def __init__(self, env: gym.Env[Any, Any]) -> None:
        super().__init__(env)
        self._lane: Any = env.unwrapped
        names = self._ask("names")
        self.coordinates, self.velocities = tuple(names["coordinates"]), tuple(names["velocities"])
        self._actuators = names["actuators"]

    @property
    def state(self) -> NDArray[np.float64]:
        """Of MuJoCo's data."""
        return np.array(self._ask("state"))

    def observation(self, state: NDArray[np.float64], seed: int) -> Named:
        """What the task makes of it."""
        return number_components("obs", self._ask("observation", state=state))

    def command(self, state: NDArray[np.float64], action: Any) -> Named:
        """The task's command to the actuators, within their limits."""
        command = self._ask("command", state=state, action=np.ravel(action).astype(np.float64))
        return name_components(self._actuators, command)

    def force(self, state: NDArray[np.float64], command: NDArray[np.float64]) -> Named:
        """`qfrc_actuator`."""
        return name_components(self.velocities, self._ask("force", state=state, command=command))

    def acceleration(self, state: NDArray[np.float64], force: NDArray[np.float64]) -> Named:
        """`qacc` with the actuators off and the force applied."""
        return name_components(self.velocities, self._ask("acceleration", state=state, force=force))

    def _ask(self, what: str, **given: NDArray[np.float64]) -> Any:
        plain = {name: values.tolist() for name, values in given.items()}
        return self._lane.worker.call(what, lane=self._lane.lane, **plain)


class DmControlTask(RemoteTestbed):
    """A task of dm_control's suite, ``"dm_control:cartpole.swingup"``, stepped by its own MuJoCo.

    dm_control counts the steps of a control period when an environment is made, and never again:
    each is made with the step that was asked for. Arguments are those of the suite's task.
    """

    apart = ISOLATED["dm_control"]
    served = Path(__file__).with_name("served_dm_control.py")
    choices = ("Euler", "RK4", "implicit", "implicitfast")

    def boundaries(self, environments: DiscretizedVectorEnv) -> DmControlBoundaries:
        """By the task's own MuJoCo."""
        return DmControlBoundaries(environments.unwrapped.envs[0])  # type: ignore[attr-defined]


class IsaaclabTask(RemoteTestbed):
    """Isaac Lab's own cart-pole, ``"isaaclab:Isaac-Cartpole-Direct"``, on Newton and the CPU.

    Its integrators are those of Newton's MuJoCo solver, by Isaac Lab's names, and ``dt`` is
    Newton's own step. Arguments are ``newton_substeps``, how many of them are taken in each of
    Isaac Lab's, and ``cart_damping``, N s/m, of the cart's actuator.
    """

    apart = ISOLATED["isaaclab"]
    served = Path(__file__).with_name("served_isaaclab.py")
    choices = ("euler", "implicitfast", "rk4")
