"""What a testbed is, and the testbeds whose environments are stepped one after the other."""

from __future__ import annotations

import math
from collections.abc import Hashable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Final, Protocol

import gymnasium as gym
from gymnasium.envs.registration import EnvSpec
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers import TimeLimit

from integ_gym.support.errors import InputError, translate_errors
from integ_gym.support.parameters import unknown_name

from .. import foreign
from ..lanes import DiscretizedVectorEnv
from ..rediscretized import is_mujoco_task
from ..settings import DELAYS, Discretization, whole_multiple
from .boundaries import Boundaries, MujocoBoundaries

REFINEMENTS = (1, 2, 4)
"""Parts of a home's coarsest step that are evaluated where no steps are given."""


def without_stated(arguments: Mapping[str, Any]) -> dict[str, Any]:
    """Arguments of an environment itself: without those that every testbed takes."""
    stated = ("success_return", *DELAYS)
    return {name: value for name, value in arguments.items() if name not in stated}


@dataclass(frozen=True)
class Applied:
    """What a made environment really does, read back from it.

    Attributes:
        discretization: engine, integrator, step and control period.
        substeps: integration steps in a control period.
    """

    discretization: Discretization
    substeps: int


@dataclass(frozen=True)
class Success:
    """What success is.

    Attributes:
        goal: in words, with numbers and units.
        parameter: the argument that sets another goal, or None.
        suggested: a value for it that is known from elsewhere, or None.
    """

    goal: str
    parameter: str | None = None
    suggested: float | None = None


class Testbed(Hashable, Protocol):
    """A task with fixed arguments, in any of the discretizations that it offers.

    Built from an environment id and the arguments that all discretizations have in common; a
    user's own, ``"module:Class"``, from the arguments alone. Nothing is checked before something
    is asked for. It may have ``boundaries(environments)`` as well, which gives what the first of
    them does before it integrates, a :class:`~integ_gym.envs.testbeds.boundaries.Boundaries`.

    Attributes:
        arguments: those arguments.
        batched: whether lanes advance together, so that many cost little more than one.
        home: the discretization that the task has by itself.
        control_period: the only one that it can have, s; None: any that ``dt`` divides.
        horizon: name of the argument that sets how long an episode lasts, s; None where that
            cannot be set.
        success: what success is.
        controller: name of its hand-made controller among the baselines, or ``"module:Class"``;
            None: none is known.
    """

    @property
    def arguments(self) -> Mapping[str, Any]: ...

    @property
    def batched(self) -> bool: ...

    @property
    def home(self) -> Discretization: ...

    @property
    def control_period(self) -> float | None: ...

    @property
    def horizon(self) -> str | None: ...

    @property
    def success(self) -> Success: ...

    @property
    def controller(self) -> str | None: ...

    def integrators(self, engine: str) -> tuple[str, ...]:
        """Names of the integrators that it offers on an engine, the truth's left out."""

    def steps(self, home: Discretization) -> tuple[float, ...]:
        """Steps, s, to evaluate a policy of that home at, where none are chosen."""

    def truth(self, control_period: float) -> Discretization | None:
        """The discretization that solves the plant to rounding; None where there is none."""

    def make(
        self, discretization: Discretization, lanes: int, **arguments: Any
    ) -> DiscretizedVectorEnv:
        """A vector environment in a discretization.

        Args:
            discretization: one that it offers.
            lanes: number of environments.
            arguments: that differ from the testbed's, and ``autoreset_mode``.

        Raises:
            TypeError, ValueError: for what cannot be made.
        """

    def applied(self, environments: DiscretizedVectorEnv) -> Applied:
        """What the environments that it made really do."""


def split_period(testbed: Testbed, discretization: Discretization) -> tuple[float, int]:
    """The control period asked for, s, else the testbed's own; and its integration steps.

    Raises:
        ValueError: for a step that does not divide it.
    """
    asked = discretization.control_period
    period = testbed.control_period if asked is None else asked
    return period, whole_multiple("control_period", period, "dt", discretization.dt)


def class_path(kind: type) -> str:
    """A class as ``"module:Class"``, by which evidence names the testbed that made a lane."""
    return f"{kind.__module__}:{kind.__qualname__}"


class SequentialTestbed:
    """A testbed without a truth, whose decisions are taken at its home's control period.

    At another one, where it can have it, episodes last as many seconds, and a decision's reward is
    multiplied by the ratio of the periods.

    Args:
        arguments: that all discretizations have in common.
    """

    batched = False
    side_by_side = 1
    """Most starts of a policy that are evaluated at once."""
    horizon = None
    controller = None
    home: Any
    """A `Discretization`."""
    title: str
    """What messages call it."""

    def __init__(self, arguments: dict[str, Any]) -> None:
        self.arguments = arguments
        self.title = type(self).__name__

    @property
    def engine(self) -> str:
        """The only one that it has."""
        return str(self.home.engine)

    @property
    def engines(self) -> tuple[str, ...]:
        """Those that it can be made with."""
        return (self.engine,)

    @property
    def control_period(self) -> float:
        """The home's."""
        return float(self.home.control_period)

    def steps(self, home: Discretization) -> tuple[float, ...]:
        """The home's, half and a quarter of it."""
        return tuple(home.dt / parts for parts in REFINEMENTS)

    def truth(self, control_period: float) -> None:
        """None: what would solve it to rounding is not known."""
        return

    def lane(self, discretization: Discretization, arguments: dict[str, Any]) -> gym.Env[Any, Any]:
        """One environment, as :class:`~integ_gym.envs.foreign.SequentialVectorEnv` takes it.

        Args:
            discretization: on this engine.
            arguments: all of its arguments.
        """
        raise NotImplementedError

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
        if discretization.engine not in self.engines:
            kind = f"engine of {self.title}"
            raise InputError(unknown_name(kind, discretization.engine, self.engines))

        def make() -> Any:
            env: Any = self.lane(discretization, {**self.arguments, **arguments})
            env.setup = replace(env.setup, testbed=class_path(type(self)))
            return env

        return self.join(make, lanes, autoreset_mode)

    def room(
        self, discretization: Discretization, arguments: Mapping[str, Any], policies: int
    ) -> int:
        """Most starts of each of some policies that are evaluated at once in a cell."""
        return self.side_by_side

    def join(self, make: Any, lanes: int, autoreset_mode: Any) -> DiscretizedVectorEnv:
        """The vector environment of what ``make`` makes for each lane."""
        return foreign.SequentialVectorEnv(make, lanes, autoreset_mode)

    def boundaries(self, environments: DiscretizedVectorEnv) -> Boundaries:
        """All four of a task of Gymnasium's MuJoCo environments; else observation and action."""
        env = environments.unwrapped.envs[0]  # type: ignore[attr-defined]
        return MujocoBoundaries(env) if is_mujoco_task(env) else Boundaries(env)


class GymTestbed(SequentialTestbed):
    """Base class of your own testbed: state four things of an environment, and the rest follows.

    ``home`` is its own discretization, ``choices`` are its integrators, :meth:`build` makes it in a
    discretization, and :meth:`read` reads back what it really applies. Decisions are taken at the
    home's control period. State, energy and truth are not known, and null in evidence.

    Args:
        success_return: an episode succeeds if its return reaches this; None: if it is not
            terminated within the time limit. A task that ends at its goal, such as Gymnasium's
            Acrobot, MountainCar and LunarLander, or one with a negative `reward_threshold`, has
            that threshold in place of None.
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
    ...         return self.held(env, discretization, rewards="rate")
    ...
    ...     def read(self, env):
    ...         return self.as_applied("rk4", env.unwrapped.dt, env)
    >>> Acrobot().success.goal
    'return of at least -100'
    """

    home: Discretization
    choices: tuple[str, ...]

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

    def held(
        self,
        env: gym.Env[Any, Any],
        discretization: Discretization,
        rewards: foreign.Rewards | None = None,
    ) -> gym.Env[Any, Any]:
        """An environment whose step is one integration step, with an action per control period.

        The action holds for as many steps as the period has. Wrappers of the environment stay and
        act in every one of these steps; its time limit is lifted and counts decisions instead.

        A decision pays the mean of its steps' rewards (``"rate"``: what a step pays does not depend
        on ``dt``), their sum (``"sum"``: amounts, such as a cost times ``dt`` or a bonus for an
        event), or that of the last step (``"last"``: a value of the state that is reached). In each
        of them the reward of the step that ends the episode counts whole, such as the bonus at a
        goal.

        Args:
            env: changed, where it has a time limit.
            discretization: asked for.
            rewards: what its rewards are. None takes them for rates, as those of Gymnasium's own
                tasks are, which pay the same for a step of any length; the page of a panel or an
                evaluation then has a doubt where the records speak against it.

        Raises:
            ValueError: for a step that does not divide the control period, for other rewards, or
                for a wrapper that would mean something else at another step.
        """
        period, count = split_period(self, discretization)
        limit, stretch = foreign.time_limit(env), self._stretch(period)
        lifted = foreign.without_time_limit(env)
        env_of_periods: gym.Env[Any, Any] = foreign.Repeated(lifted, count, rewards, stretch)
        return env_of_periods if limit is None else TimeLimit(env_of_periods, limit)

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
            raise InputError(
                f"{type(self).__name__}.read calls `as_applied`, which is for environments that "
                "`build` gives to `held`; of others, return an Applied"
            )
        count = int(env.get_wrapper_attr("count"))
        return Applied(Discretization(integrator, dt, dt * count, self.home.engine), count)

    @property
    def success(self) -> Success:
        """Survival, or a return.

        Raises:
            ValueError: for a task that ends at its goal and does not say which return is a success.
        """
        spec, wanted = self.registered, self.arguments.get("success_return")
        known = None if spec is None else spec.reward_threshold
        goal = foreign.ReturnGoal(foreign.return_of_success(wanted, spec))
        return Success(goal.words, "success_return", known)

    @cached_property
    def registered(self) -> EnvSpec | None:
        """What Gymnasium's registration says of the environment; None without one."""
        env = self._build_checked(self.home, self.arguments)
        spec = env.spec
        env.close()
        return spec

    def integrators(self, engine: str) -> tuple[str, ...]:
        """Those that can be chosen."""
        return self.choices

    def lane(self, discretization: Discretization, arguments: dict[str, Any]) -> foreign.StatedEnv:
        """What was built, and what it applies.

        Raises:
            ValueError: for an integrator that cannot be chosen, and a wrapper that counts decisions
                where these take another time than the home's.
        """
        if discretization.integrator not in self.choices:
            kind = f"integrator of {self.title}"
            raise InputError(unknown_name(kind, discretization.integrator, self.choices))
        env = self._build_checked(discretization, arguments)
        applied, wanted = self.read(env).discretization, arguments.get("success_return")
        stretch = self._stretch(applied.control_period)
        if stretch != 1.0:
            foreign.check_wrappers(
                "another control period", foreign.wrappers_of(env), foreign.COUNTS_DECISIONS
            )
        return foreign.StatedEnv(env, applied, wanted, arguments, stretch)

    def _stretch(self, period: float) -> float:
        """A control period, s, over the home's."""
        stretch = period / self.home.control_period
        return 1.0 if math.isclose(stretch, 1.0) else stretch

    def _build_checked(
        self, discretization: Discretization, arguments: Mapping[str, Any]
    ) -> gym.Env[Any, Any]:
        """What :meth:`build` makes, given all arguments of the testbed."""
        with translate_errors(f"the environment of {self.title} cannot be made"):
            return self.build(discretization, **without_stated(arguments))

    def applied(self, environments: DiscretizedVectorEnv) -> Applied:
        """Read back from the first lane."""
        return self.read(environments.unwrapped.envs[0])  # type: ignore[attr-defined]


ENGINE: Final = "gymnasium"


@dataclass(frozen=True)
class Knobs:
    """Where an environment keeps its discretization.

    Attributes:
        step: attribute that holds the integration step, s.
        integrators: name to value of ``kind``.
        kind: attribute that holds the integrator; None where there is one alone.
    """

    step: str
    integrators: Mapping[str, str]
    kind: str | None = None


CLASSIC: Final = {
    "Acrobot-v1": Knobs("dt", {"rk4": ""}),
    "CartPole-v1": Knobs(
        "tau",
        {"explicit_euler": "euler", "symplectic_euler": "semi-implicit euler"},
        "kinematics_integrator",
    ),
    "Pendulum-v1": Knobs("dt", {"symplectic_euler": ""}),
}
"""Environment id to its knobs; the integrators by the field's names."""


class ClassicControl(GymTestbed):
    """One of Gymnasium's classic control environments, the library's own code.

    An action holds for the home's control period, in which the environment takes as many steps as
    that has. Their rewards are rates: a period pays their mean. ``IntegPendulum-v0`` and
    ``IntegCartPole-v0`` are two of them at the same discretization, with state, energy, more
    integrators and a truth.

    Args:
        env_id: its id.
        arguments: see :class:`GymTestbed`.
    """

    def __init__(self, env_id: str, **arguments: Any) -> None:
        super().__init__(**arguments)
        self.env_id = env_id
        self._knobs = CLASSIC[env_id]
        self.choices = tuple(self._knobs.integrators)
        self.registered = gym.spec(env_id)
        stock = gym.make(env_id)
        integrator, step = self._read_attributes(stock)
        self.home = Discretization(integrator, step, step, ENGINE)
        stock.close()

    def build(self, discretization: Discretization, **arguments: Any) -> gym.Env[Any, Any]:
        """The environment with its attributes set.

        Raises:
            ValueError: for a step that does not divide the control period.
        """
        env_of_periods = gym.make(self.env_id, **arguments)
        inner: Any = env_of_periods.unwrapped
        setattr(inner, self._knobs.step, discretization.dt)
        if self._knobs.kind is not None:
            setattr(inner, self._knobs.kind, self._knobs.integrators[discretization.integrator])
        return self.held(env_of_periods, discretization, rewards="rate")

    def read(self, env: gym.Env[Any, Any]) -> Applied:
        """From the attributes."""
        return self.as_applied(*self._read_attributes(env), env)

    def _read_attributes(self, env: gym.Env[Any, Any]) -> tuple[str, float]:
        """Integrator and step, s."""
        inner, knobs = env.unwrapped, self._knobs
        kind = "" if knobs.kind is None else getattr(inner, knobs.kind)
        name = next(own for own, value in knobs.integrators.items() if value == kind)
        return name, float(getattr(inner, knobs.step))
