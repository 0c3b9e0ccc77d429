"""Any Gymnasium environment whose discretization can be set, as a testbed."""

from __future__ import annotations

from functools import partial
from typing import Any

import gymnasium as gym
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers import TimeLimit

from integ_gym.support import unknown_name

from ..environments import DiscretizedVectorEnv, Repeated, SequentialVectorEnv, StatedEnv
from ..episode import Discretization, whole_multiple
from .interface import REFINEMENTS, Applied, Success


class GymTestbed:
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
    batched = False
    horizon = None
    controller = None
    suggested_return: float | None = None
    """A return that is known to be a success."""

    def __init__(self, success_return: float | None = None, **arguments: Any) -> None:
        self.success_return = success_return
        self.arguments = arguments if success_return is None else {
            **arguments, "success_return": success_return,
        }  # fmt: skip
        self._own = arguments

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
        """
        count = int(env.get_wrapper_attr("count"))
        return Applied(Discretization(integrator, dt, dt * count, self.home.engine), count)

    @property
    def control_period(self) -> float:
        """The home's."""
        return self.home.control_period

    @property
    def success(self) -> Success:
        """Survival, or a return."""
        env = self._stated(self.home, {})
        env.close()
        return Success(env.setup.task.goal, "success_return", self.suggested_return)

    def integrators(self, engine: str) -> tuple[str, ...]:
        """Those that can be chosen."""
        return self.choices

    def steps(self, home: Discretization) -> tuple[float, ...]:
        """The home's, half and a quarter of it."""
        return tuple(home.dt / parts for parts in REFINEMENTS)

    def truth(self, control_period: float) -> None:
        """None: what would solve it to rounding is not known."""
        return

    def make(
        self,
        discretization: Discretization,
        lanes: int,
        *,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        **arguments: Any,
    ) -> DiscretizedVectorEnv:
        """One environment per lane.

        Raises:
            TypeError, ValueError: for a discretization that it cannot have.
        """
        name = type(self).__name__
        home = self.home
        for kind, asked, known in (
            ("engine", discretization.engine, [home.engine]),
            ("integrator", discretization.integrator, self.choices),
        ):
            if asked not in known:
                raise ValueError(unknown_name(f"{kind} of {name}", asked, known))
        make = partial(self._stated, discretization, arguments)
        return SequentialVectorEnv(make, lanes, autoreset_mode)

    def applied(self, environments: DiscretizedVectorEnv) -> Applied:
        """Read back from the first lane."""
        return self.read(environments.unwrapped.envs[0])  # type: ignore[attr-defined]

    def _stated(self, discretization: Discretization, further: dict[str, Any]) -> StatedEnv:
        given = {**self._own, **further}
        wanted = given.pop("success_return", self.success_return)
        env = self.build(discretization, **given)
        return StatedEnv(env, self.read(env).discretization, wanted, given)
