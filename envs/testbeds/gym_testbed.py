"""Any Gymnasium environment whose discretization can be set, as a testbed."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
from gymnasium.wrappers import TimeLimit

from integ_gym.support import unknown_name

from ..environments import DiscretizedVectorEnv, Repeated, ReturnGoal, StatedEnv
from ..episode import Discretization, whole_multiple
from .interface import Applied, Success
from .sequential import SequentialTestbed


class GymTestbed(SequentialTestbed):
    """Base of a testbed of one's own: four things are said of an environment, the rest follows.

    ``home``, the discretization that it has by itself; ``choices``, its integrators; :meth:`build`,
    how it is made in a discretization; :meth:`read`, what a made one really applies. Decisions are
    taken at the home's control period. State, energy and truth are not known, and null in evidence.

    Args:
        success_return: an episode succeeds if its return reaches this; None: if it is not
            terminated within the time limit.
        arguments: of the environment, handed to :meth:`build`.

    >>> import gymnasium as gym
    >>> import integ_gym
    >>> class Acrobot(integ_gym.GymTestbed):
    ...     home = integ_gym.Discretization("rk4", 0.2, 0.2, "gymnasium")
    ...     choices = ("rk4",)
    ...
    ...     def build(self, discretization, **arguments):
    ...         env = gym.make("Acrobot-v1", **arguments)
    ...         env.unwrapped.dt = discretization.dt
    ...         return self.held(env, discretization)
    ...
    ...     def read(self, env):
    ...         return self.as_applied("rk4", env.unwrapped.dt, env)
    >>> Acrobot().success.goal
    'not terminated within the time limit'
    """

    home: Discretization
    choices: tuple[str, ...]
    suggested_return: float | None = None
    """A return that is known to be a success."""

    def __init__(self, success_return: float | None = None, **arguments: Any) -> None:
        goal = {} if success_return is None else {"success_return": success_return}
        super().__init__({**arguments, **goal})

    def build(self, discretization: Discretization, **arguments: Any) -> gym.Env[Any, Any]:
        """An environment in a discretization, with a time limit; one step is one decision.

        Raises:
            ValueError: for a discretization that it cannot have.
        """
        raise NotImplementedError(f"{type(self).__name__} must define `build`")

    def read(self, env: gym.Env[Any, Any]) -> Applied:
        """What an environment that was made really applies, read back from it."""
        raise NotImplementedError(f"{type(self).__name__} must define `read`")

    def held(self, env: gym.Env[Any, Any], discretization: Discretization) -> gym.Env[Any, Any]:
        """An environment whose step is one integration step, with an action per control period.

        The action holds for as many steps as the period has, the reward is the mean of theirs, and
        the time limit that Gymnasium gave it counts decisions.

        Raises:
            ValueError: for a step that does not divide the control period.
        """
        count = whole_multiple("control_period", self.home.control_period, "dt", discretization.dt)
        limit = env.spec.max_episode_steps if env.spec else None
        made: gym.Env[Any, Any] = Repeated(env.unwrapped, count)
        return made if limit is None else TimeLimit(made, limit)

    def as_applied(self, integrator: str, dt: float, env: gym.Env[Any, Any]) -> Applied:
        """What an environment that :meth:`held` made applies, given what was read back from it.

        Args:
            integrator: its integrator.
            dt: its integration step, s.
            env: made by :meth:`held`.

        Raises:
            ValueError: for another environment.
        """
        if not env.has_wrapper_attr("count"):
            raise ValueError(
                f"{type(self).__name__}.read calls `as_applied`, which is for environments that "
                "`build` gives to `held`; of others, return an Applied"
            )
        count = int(env.get_wrapper_attr("count"))
        return Applied(Discretization(integrator, dt, dt * count, self.home.engine), count)

    @property
    def success(self) -> Success:
        """Survival, or a return."""
        goal = ReturnGoal(self.arguments.get("success_return"))
        return Success(goal.words, "success_return", self.suggested_return)

    def integrators(self, engine: str) -> tuple[str, ...]:
        """Those that can be chosen."""
        return self.choices

    def lane(self, discretization: Discretization, arguments: dict[str, Any]) -> StatedEnv:
        """What was built, and what it applies.

        Raises:
            ValueError: for an integrator that cannot be chosen.
        """
        if discretization.integrator not in self.choices:
            kind = f"integrator of {self.title}"
            raise ValueError(unknown_name(kind, discretization.integrator, self.choices))
        given = {**arguments}
        wanted = given.pop("success_return", None)
        env = self.build(discretization, **given)
        return StatedEnv(env, self.read(env).discretization, wanted, given)

    def applied(self, environments: DiscretizedVectorEnv) -> Applied:
        """Read back from the first lane."""
        return self.read(environments.unwrapped.envs[0])  # type: ignore[attr-defined]
