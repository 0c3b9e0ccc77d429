"""Gymnasium's MuJoCo tasks as testbeds."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import Any

import gymnasium as gym

from integ_gym.support.errors import InputError, describe_exception, translate_errors
from integ_gym.support.optional import check_versions, load
from integ_gym.support.parameters import suggestion

from ..catalogue.lookup import OTHER_TESTBEDS
from ..rediscretized import RediscretizedEnv, integrator_numbers, rediscretize
from ..registries import ENVIRONMENTS
from ..sequential_vector import DiscretizedVectorEnv
from ..settings import Discretization
from .gym_testbed import SequentialTestbed
from .interface import Applied, Success

ENGINE = "mujoco"


class MujocoTestbed(SequentialTestbed):
    """A MuJoCo task, rediscretized. It has no truth: contacts have no reference solution.

    Args:
        env_id: its id.
        arguments: of its ``gymnasium.make``, and ``success_return``: an episode succeeds if its
            return reaches this; without it, if it is not terminated.
    """

    engine = ENGINE

    def __init__(self, env_id: str, **arguments: Any) -> None:
        super().__init__(arguments)
        self.env_id = self.title = env_id

    @cached_property
    def _setup(self) -> Any:
        env = _made(self.env_id, self.arguments)
        env.close()
        return env.setup

    @property
    def home(self) -> Discretization:
        """The stock task, with its model's integrator and timestep."""
        return Discretization.of(self._setup)

    @property
    def success(self) -> Success:
        """Survival, or a return."""
        threshold = gym.spec(self.env_id.rpartition(":")[2]).reward_threshold
        return Success(self._setup.task.goal, "success_return", threshold)

    def integrators(self, engine: str) -> tuple[str, ...]:
        """MuJoCo's."""
        return tuple(integrator_numbers())

    def lane(self, discretization: Discretization, arguments: dict[str, Any]) -> RediscretizedEnv:
        """A rediscretized task.

        Raises:
            ValueError: for another integrator or step than it can have.
        """
        chosen = {"integrator": discretization.integrator, "dt": discretization.dt}
        return _made(self.env_id, arguments, **chosen)

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
    possible = f"give {', '.join(ENVIRONMENTS)}, {OTHER_TESTBEDS}"
    module, _, name = env_id.rpartition(":")
    if module:
        with translate_errors(f"{module} cannot be imported"):
            load(module, "robotics")
    try:
        gym.spec(name)
    except gym.error.Error as error:
        own = suggestion(env_id, ENVIRONMENTS)
        meant = "" if own.startswith("Did you mean") else f" {error}"
        raise InputError(
            f"unknown environment: {env_id!r}.{meant} {own}, {OTHER_TESTBEDS}"
        ) from error
    check_versions("robotics" if module else "mujoco")
    load("mujoco", "mujoco")
    load("imageio", "mujoco")
    from gymnasium.envs.mujoco import MujocoEnv

    try:
        env = gym.make(name, **arguments)
    except Exception as error:  # whatever the task's constructor raises
        raise InputError(
            f"Gymnasium cannot make {env_id!r}: {describe_exception(error)}; {possible}"
        ) from error
    if not isinstance(env.unwrapped, MujocoEnv):
        raise InputError(f"{env_id!r} is no MuJoCo task; {possible}")
    if env.spec is None or env.spec.max_episode_steps is None:
        raise InputError(
            f"{env_id!r} has no time limit, so its episodes may never end; register it with "
            "`max_episode_steps`"
        )
    return env
