"""Gymnasium's MuJoCo tasks as testbeds."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property, partial
from typing import Any

import gymnasium as gym
from gymnasium.vector import AutoresetMode

from integ_gym.support import load, suggestion, unknown_name

from ..catalogue import BRING_YOUR_OWN, ENVIRONMENTS
from ..environments import DiscretizedVectorEnv, SequentialVectorEnv
from ..environments.rediscretized import (
    RediscretizedEnv,
    TaskSetup,
    integrator_numbers,
    rediscretize,
)
from ..episode import Discretization
from .interface import REFINEMENTS, Applied, Success

ENGINE = "mujoco"


class MujocoTestbed:
    """A MuJoCo task, rediscretized. It has no truth: contacts have no reference solution.

    Args:
        env_id: its id.
        arguments: of its ``gymnasium.make``, and ``success_return``: an episode succeeds if its
            return reaches this; without it, if it is not terminated.
    """

    batched = False
    horizon = None
    controller = None

    def __init__(self, env_id: str, **arguments: Any) -> None:
        self.env_id = env_id
        self.arguments = arguments

    @cached_property
    def _setup(self) -> TaskSetup:
        env = _made(self.env_id, self.arguments)
        env.close()
        return env.setup

    @property
    def home(self) -> Discretization:
        """The stock task, with its model's integrator and timestep."""
        return Discretization.of(self._setup)

    @property
    def control_period(self) -> float:
        """The task's own."""
        return self.home.control_period

    @property
    def success(self) -> Success:
        """Survival, or a return."""
        threshold = gym.spec(self.env_id).reward_threshold
        return Success(self._setup.task.goal, "success_return", threshold)

    def integrators(self, engine: str) -> tuple[str, ...]:
        """MuJoCo's."""
        return tuple(integrator_numbers())

    def steps(self, home: Discretization) -> tuple[float, ...]:
        """The home's, half and a quarter of it."""
        return tuple(home.dt / parts for parts in REFINEMENTS)

    def truth(self, control_period: float) -> None:
        """None."""
        return

    def make(
        self,
        discretization: Discretization,
        lanes: int,
        *,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        **arguments: Any,
    ) -> DiscretizedVectorEnv:
        """One rediscretized task per lane.

        Raises:
            ValueError: for another engine, integrator or control period than it can have.
        """
        if discretization.engine != ENGINE:
            raise ValueError(
                unknown_name(f"engine of {self.env_id}", discretization.engine, [ENGINE])
            )
        chosen = {"integrator": discretization.integrator, "dt": discretization.dt}
        given = {**self.arguments, **arguments}
        return SequentialVectorEnv(
            partial(_made, self.env_id, given, **chosen), lanes, autoreset_mode
        )

    def applied(self, environments: DiscretizedVectorEnv) -> Applied:
        """From the compiled model of the first lane."""
        task: RediscretizedEnv = environments.unwrapped.envs[0]  # type: ignore[attr-defined]
        integrator, step, count = task.applied
        return Applied(Discretization(integrator, step, step * count, ENGINE), count)


def _made(env_id: str, arguments: Mapping[str, Any], **chosen: Any) -> RediscretizedEnv:
    others = {name: value for name, value in arguments.items() if name != "success_return"}
    goal = arguments.get("success_return")
    return rediscretize(stock_task(env_id, others), success_return=goal, **chosen)


def stock_task(env_id: str, arguments: Mapping[str, Any]) -> gym.Env[Any, Any]:
    """A MuJoCo task as Gymnasium makes it.

    Raises:
        ValueError: for an environment that Gymnasium cannot make or that is no MuJoCo task, or one
            without a time limit.
    """
    possible = f"give {', '.join(ENVIRONMENTS)}, a MuJoCo task such as Hopper-v5, {BRING_YOUR_OWN}"
    try:
        gym.spec(env_id)
    except gym.error.Error as error:
        raise ValueError(
            f"unknown environment: Gymnasium cannot make {env_id!r}: {_reason(error)}. "
            f"{suggestion(env_id, ENVIRONMENTS)}, a MuJoCo task such as Hopper-v5, {BRING_YOUR_OWN}"
        ) from error
    load("mujoco", "mujoco")
    load("imageio", "mujoco")
    from gymnasium.envs.mujoco import MujocoEnv

    try:
        env = gym.make(env_id, **arguments)
    except (gym.error.Error, TypeError, ValueError, OSError, ImportError) as error:
        raise ValueError(
            f"Gymnasium cannot make {env_id!r}: {_reason(error)}; {possible}"
        ) from error
    if not isinstance(env.unwrapped, MujocoEnv):
        raise ValueError(f"{env_id!r} is no MuJoCo task; {possible}")
    if env.spec is None or env.spec.max_episode_steps is None:
        raise ValueError(
            f"{env_id!r} has no time limit, so its episodes may never end; register it with "
            "`max_episode_steps`"
        )
    return env


def _reason(error: Exception) -> str:
    return " ".join(str(error).split()).rstrip(".")
