"""Brax's tasks as testbeds, a backend for an integrator."""

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
from ..episode.timing import whole_multiple
from .gym_testbed import GymTestbed
from .interface import Applied
from .state_passing import StatePassing, step_told

ENGINE = "brax"
BACKENDS = ("generalized", "mjx", "positional", "spring")
DECISIONS = 1000
"""Of an episode, as Brax's own training has them."""


class BraxTask(GymTestbed):
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
        super().__init__(success_return, **arguments)
        self.task = self.title = task
        self.registered = EnvSpec(f"{task}-v0")
        self._tasks: dict[tuple[Any, ...], Any] = {}
        check_versions("brax")
        self._envs = load("brax.envs", "brax")
        if task not in self._envs._envs:
            raise ValueError(unknown_name("task of Brax", task, self._envs._envs))
        stock = self._envs.get_environment(task, backend=backend, **arguments)
        step = step_told(stock.sys.opt.timestep)
        self.home = Discretization(backend, step, step * stock._n_frames, ENGINE)

    def build(self, discretization: Discretization, **arguments: Any) -> gym.Env[Any, Any]:
        """The task on a backend, with its step and its steps per decision.

        Raises:
            ValueError: for a step that does not divide the control period.
        """
        period = discretization.control_period or self.control_period
        count = whole_multiple("control_period", period, "dt", discretization.dt)
        key = discretization.integrator, discretization.dt, count, json.dumps(arguments)
        if key not in self._tasks:
            chosen = {"backend": discretization.integrator, "n_frames": count}
            task = self._envs.get_environment(self.task, **chosen, **arguments)
            task.sys = task.sys.tree_replace({"opt.timestep": discretization.dt})
            self._tasks[key] = task
        return TimeLimit(StatePassing(self.task, self._tasks[key]), DECISIONS)

    def read(self, env: gym.Env[Any, Any]) -> Applied:
        """From the task's system and its steps per decision."""
        task: Any = env.unwrapped.inner  # type: ignore[attr-defined]
        step = step_told(task.sys.opt.timestep)
        return Applied(
            Discretization(task._backend, step, step * task._n_frames, ENGINE), task._n_frames
        )
