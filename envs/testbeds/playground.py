"""MuJoCo Playground's tasks as testbeds."""

from __future__ import annotations

import json
from typing import Any

import gymnasium as gym
from gymnasium.envs.registration import EnvSpec
from gymnasium.wrappers import TimeLimit

from integ_gym.support.packages.extras import load
from integ_gym.support.packages.versions import check_versions
from integ_gym.support.parameters import unknown_name

from ..episode.discretization import Discretization
from .gym_testbed import GymTestbed
from .interface import Applied
from .state_passing import StatePassing, step_told

ENGINE = "playground"
INTEGRATORS = {"Euler": 0, "RK4": 1, "implicitfast": 3}
"""MuJoCo's numbers of those that MJX has."""


class Playground(GymTestbed):
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
        super().__init__(success_return, **arguments)
        self.task = self.title = task
        self.registered = EnvSpec(f"{task}-v0")
        check_versions("playground")
        self._registry = load("mujoco_playground", "playground").registry
        if task not in self._registry.ALL_ENVS:
            raise ValueError(unknown_name("task of Playground", task, self._registry.ALL_ENVS))
        self._tasks: dict[tuple[str | None, str], Any] = {}
        config = self._registry.get_default_config(task)
        stock = self._made(None, config.sim_dt, config.ctrl_dt, **arguments)
        self.home = self.read(stock).discretization

    def build(self, discretization: Discretization, **arguments: Any) -> gym.Env[Any, Any]:
        """The task at its configured step and control period.

        Raises:
            ValueError: for a configuration that Playground does not take.
        """
        period = discretization.control_period or self.control_period
        made: gym.Env[Any, Any] = self._made(
            discretization.integrator, discretization.dt, period, **arguments
        )
        return made

    def read(self, env: gym.Env[Any, Any]) -> Applied:
        """From the compiled model, and from how often the task steps it."""
        task: Any = env.unwrapped.inner  # type: ignore[attr-defined]
        number = int(task.mjx_model.opt.integrator)
        name = next((own for own, n in INTEGRATORS.items() if n == number), str(number))
        step = step_told(task.mjx_model.opt.timestep)
        return Applied(Discretization(name, step, step * task.n_substeps, ENGINE), task.n_substeps)

    def _made(self, integrator: str | None, dt: float, period: float, **arguments: Any) -> Any:
        overrides = {"impl": "jax", **arguments, "sim_dt": dt, "ctrl_dt": period}
        key = integrator, json.dumps(overrides, sort_keys=True)
        if key not in self._tasks:
            self._tasks[key] = self._task(integrator, overrides)
        length = self._registry.get_default_config(self.task).episode_length
        return TimeLimit(StatePassing(self.task, self._tasks[key]), length)

    def _task(self, integrator: str | None, overrides: dict[str, Any]) -> Any:
        task = self._registry.load(self.task, config_overrides=overrides)
        if integrator is not None:
            mjx = load("mujoco.mjx", "mjx")
            task.mj_model.opt.integrator = INTEGRATORS[integrator]
            task._mjx_model = mjx.put_model(task.mj_model, impl=overrides["impl"])
        return task
