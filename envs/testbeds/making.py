"""The testbed of an environment id: of our own environments, of MuJoCo tasks, of others."""

from __future__ import annotations

import json
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from functools import cached_property, lru_cache
from inspect import getattr_static
from typing import Any

import gymnasium as gym
from gymnasium.vector import AutoresetMode

from integ_gym.support.errors import (
    InputError,
    InputTypeError,
    describe_exception,
    translate_errors,
)
from integ_gym.support.optional import check_versions, load
from integ_gym.support.parameters import suggestion

from .. import environment
from ..engines.stepping import without_idle_solver
from ..foreign import MixedEnv, SequentialVectorEnv
from ..lanes import DiscretizedVectorEnv
from ..rediscretized import RediscretizedEnv, integrator_numbers, rediscretize
from ..registries import ENGINES, ENVIRONMENTS, TESTBEDS, TRUTH
from ..settings import (
    DELAYS,
    DISCRETIZATION,
    Discretization,
    Mixture,
    agrees,
    dividing_step,
    parse_mixture,
)
from .boundaries import IntegBoundaries
from .gym_testbed import (
    CLASSIC,
    REFINEMENTS,
    Applied,
    ClassicControl,
    SequentialTestbed,
    Success,
    Testbed,
)

ENGINE = "mujoco"


class MujocoTestbed(SequentialTestbed):
    """A MuJoCo task, rediscretized. It has no truth: contacts have no reference solution.

    Args:
        env_id: its id.
        arguments: of its ``gymnasium.make``, and those of :func:`integ_gym.rediscretize`.
    """

    engine = ENGINE
    side_by_side = 4  # more than that do not fit a core's cache

    def __init__(self, env_id: str, **arguments: Any) -> None:
        super().__init__(arguments)
        self.env_id = self.title = env_id

    @cached_property
    def _setup(self) -> Any:
        env = _make_task(self.env_id, self.arguments)
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
        names = ("integrator", "dt", "control_period")
        chosen = {name: getattr(discretization, name) for name in names}
        return _make_task(self.env_id, arguments, **chosen)

    def applied(self, environments: DiscretizedVectorEnv) -> Applied:
        """From the compiled model of the first lane."""
        task: RediscretizedEnv = environments.unwrapped.envs[0]  # type: ignore[attr-defined]
        integrator, step, count = task.applied
        return Applied(Discretization(integrator, step, step * count, ENGINE), count)


def _make_task(env_id: str, arguments: Mapping[str, Any], **chosen: Any) -> RediscretizedEnv:
    names = ("success_return", "solver", *DELAYS)
    own = {name: arguments.get(name) for name in names}
    others = {name: value for name, value in arguments.items() if name not in own}
    return rediscretize(stock_task(env_id, others), **own, **chosen)


@contextmanager
def _no_deprecations() -> Iterator[None]:
    """Lets models compile without a warning that their file has a deprecated attribute.

    MuJoCo 4.0 writes one to standard error and to MUJOCO_LOG.TXT whenever HalfCheetah-v5 is made.
    """
    mujoco = load("mujoco", "mujoco")
    before = mujoco.get_mju_user_warning()

    def warn(message: str) -> None:
        if "is deprecated" not in message:
            (before or warnings.warn)(message)

    mujoco.set_mju_user_warning(warn)
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(before)


def stock_task(env_id: str, arguments: Mapping[str, Any]) -> gym.Env[Any, Any]:
    """A MuJoCo task as Gymnasium makes it.

    Raises:
        ValueError: for an environment that Gymnasium cannot make or that is no MuJoCo task, or one
            without a time limit.
    """
    possible = f"give {', '.join(ENVIRONMENTS)}, {environment.OTHER_TESTBEDS}"
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
            f"unknown environment: {env_id!r}.{meant} {own}, {environment.OTHER_TESTBEDS}"
        ) from error
    check_versions("robotics" if module else "mujoco")
    load("mujoco", "mujoco")
    load("imageio", "mujoco")
    from gymnasium.envs.mujoco import MujocoEnv

    try:
        with _no_deprecations():
            env = gym.make(name, **arguments)
    except Exception as error:  # whatever the task's constructor raises
        remedy = f"change {' or '.join(arguments)}, or leave it out" if arguments else possible
        raise InputError(
            f"Gymnasium cannot make {env_id!r}: {describe_exception(error)}; {remedy}"
        ) from error
    if not isinstance(env.unwrapped, MujocoEnv):
        raise InputError(f"{env_id!r} is no MuJoCo task; {possible}")
    if env.spec is None or env.spec.max_episode_steps is None:
        raise InputError(
            f"{env_id!r} has no time limit, so its episodes may never end; register it with "
            "`max_episode_steps`"
        )
    return env


class IntegTestbed:
    """One of the environments that integ-gym registers.

    Args:
        env_id: its id.
        arguments: of its constructor, without the discretization.
    """

    batched = True
    control_period = None
    horizon = "duration"

    def __init__(self, env_id: str, **arguments: Any) -> None:
        self.env_id = env_id
        self.arguments = arguments

    @property
    def home(self) -> Discretization:
        """The environment's defaults."""
        return Discretization.of(environment.environment_setup(self.env_id, {}))

    @property
    def success(self) -> Success:
        """The task's goal."""
        return Success(
            environment.task_of(environment.environment_class(self.env_id), self.arguments).goal
        )

    @property
    def controller(self) -> str:
        """Hand-made controllers are named as their tasks."""
        return environment.environment_class(self.env_id).task_name

    def integrators(self, engine: str) -> tuple[str, ...]:
        """The engine's own names."""
        return tuple(name for name in ENGINES.load(engine).maps if name != TRUTH)

    def steps(self, home: Discretization) -> tuple[float, ...]:
        """The control period, half and a quarter of it, or of a part that divides all delays."""
        coarsest = dividing_step({**self.arguments, "dt": home.control_period})
        return tuple(coarsest / parts for parts in REFINEMENTS)

    def truth(self, control_period: float) -> Discretization:
        """The reference at one step per decision, for its result does not depend on the step."""
        return Discretization(TRUTH, control_period, control_period)

    def make(
        self, discretization: Discretization, lanes: int, **arguments: Any
    ) -> DiscretizedVectorEnv:
        """As ``gymnasium.make_vec``; settings of a solver act where the integrator has one."""
        given = without_idle_solver({**self.arguments, **discretization.arguments(), **arguments})
        env = gym.make_vec(self.env_id, lanes, vectorization_mode="vector_entry_point", **given)
        assert isinstance(env, DiscretizedVectorEnv)
        return env

    def applied(self, environments: DiscretizedVectorEnv) -> Applied:
        """From the setup, which is what the environments step."""
        (setup,) = environments.setups
        return Applied(Discretization.of(setup), setup.timing.substeps)

    def boundaries(self, environments: DiscretizedVectorEnv) -> IntegBoundaries:
        """From the setup and the engine."""
        return IntegBoundaries(environments)


_MEMBERS = (
    "arguments", "batched", "home", "control_period", "horizon", "success", "controller",
    "integrators", "steps", "truth", "make", "applied",
)  # fmt: skip
"""What every testbed has."""

_ROBOTICS = "gymnasium_robotics"
"""Package whose tasks are MuJoCo tasks of Gymnasium's kind."""


def find_testbed(env_id: str, arguments: Mapping[str, Any]) -> Testbed:
    """The testbed of an environment id; the same object for the same arguments.

    Args:
        env_id: of one of integ-gym's environments, of Gymnasium's classic control with a step to
            set, or of one of its MuJoCo tasks; of another library's, ``"playground:Task"``,
            ``"brax:task"``, ``"dm_control:domain.task"``, ``"isaaclab:Task"`` and
            ``"gymnasium_robotics:Task-v1"``; of a user's own,
            ``"module:Id-v0"`` for an environment and ``"module:Class"`` for a testbed.
        arguments: that all discretizations have in common, JSON-serialisable.

    Raises:
        ValueError: for a reference that cannot be loaded. An id that is unknown is refused, with
            what is possible, by what first makes its environment.
    """
    return _load_testbed(env_id, json.dumps(dict(arguments), sort_keys=True))


@lru_cache(maxsize=64)
def _load_testbed(env_id: str, arguments: str) -> Testbed:
    given = json.loads(arguments)
    if environment.is_integ_environment(env_id):
        return IntegTestbed(env_id, **given)
    if env_id in CLASSIC:
        return ClassicControl(env_id, **given)
    library, _, task = env_id.partition(":")
    if task and library in TESTBEDS:
        with translate_errors(f"{env_id} cannot be made"):
            testbed: Testbed = TESTBEDS.load(library)(task, **given)
            return testbed
    if task and library != _ROBOTICS:
        owner = TESTBEDS.load(env_id)
        with translate_errors(f"the testbed {env_id} cannot be made"):
            return _complete(owner(**given), env_id)
    return MujocoTestbed(env_id, **given)


def _complete(testbed: Testbed, env_id: str) -> Testbed:
    """A user's own testbed.

    Raises:
        ValueError: if it lacks something.
    """
    missing = [name for name in _MEMBERS if not _has(testbed, name)]
    if missing:
        raise InputError(
            f"the testbed {env_id!r} lacks {', '.join(missing)}; docs/how-to/testbeds.md says what "
            "a testbed has"
        )
    return testbed


def _has(testbed: Testbed, name: str) -> bool:
    """Whether a testbed has a member; of a property, whose value may take a while, its owner."""
    return getattr_static(testbed, name, None) is not None or hasattr(testbed, name)


def make_checked(
    testbed: Testbed, discretization: Discretization, lanes: int, **arguments: Any
) -> DiscretizedVectorEnv:
    """The testbed's environments in a discretization, which they really apply.

    Args:
        testbed: what makes them.
        discretization: asked for.
        lanes: number of environments.
        arguments: see :meth:`Testbed.make`.

    Raises:
        ValueError: if they apply another discretization, with both values.
        TypeError, ValueError: for what the testbed refuses.
    """
    title = getattr(testbed, "title", type(testbed).__name__)
    with translate_errors(f"the environment of {title} cannot be made"):
        environments = testbed.make(discretization, lanes, **arguments)
    try:
        with translate_errors(f"what the environment of {title} applies cannot be read"):
            applied = testbed.applied(environments)
        _check(discretization, applied)
    except BaseException:
        environments.close()
        raise
    return environments


def _check(asked: Discretization, applied: Applied) -> None:
    """Hold what was asked for against what is applied, sub-steps included."""
    if not isinstance(applied, Applied):
        raise InputTypeError(
            f"a testbed must state what is applied by an Applied, got {applied!r:.60}"
        )
    found = applied.discretization
    whole = replace(found, control_period=applied.substeps * found.dt)
    for applies in (found.arguments(), whole.arguments()):
        for name, wanted in asked.arguments().items():
            if not agrees({name: wanted}, applies):
                raise InputError(
                    f"`{name}`={wanted} was asked for, but the environment applies "
                    f"{applies[name]}; ask for what it can apply"
                )


def _make_mixed(
    testbed: Testbed, stated: Mapping[str, Any], members: Any, lanes: int, mode: str
) -> DiscretizedVectorEnv:
    """Environments of others whose episodes draw from a mixture.

    Args:
        testbed: makes them, one of each discretization for every lane.
        stated: what members have in common; what they leave out is the home's.
        members: see :func:`~integ_gym.envs.settings.make_mixture`.
        lanes: number of environments.
        mode: when they are reset.
    """
    given, shares = parse_mixture(stated, members)
    places = [Discretization(**{**testbed.home.arguments(), **place}) for place in given]
    environments_of: dict[Discretization, Any] = {}
    for place in places:
        environments = environments_of[place] = make_checked(testbed, place, lanes)
        if not isinstance(environments, SequentialVectorEnv):
            raise InputError(
                f"lanes of {type(testbed).__name__} advance together, each in one discretization, "
                "so it has no `mixture`; train on one"
            )
        environments.closed = True  # another has its lanes
    mixture = Mixture(tuple(environments_of[place].setup for place in places), shares)
    rows = zip(*(environments_of[place].envs for place in places), strict=True)
    return SequentialVectorEnv(lambda: MixedEnv(next(rows), mixture), lanes, mode)


def make_training_environments(
    env_id: str, arguments: Mapping[str, Any], lanes: int
) -> DiscretizedVectorEnv:
    """Environments to train in, which reset within the step that ends an episode.

    Args:
        env_id: see :func:`find_testbed`.
        arguments: of the environment, its discretization or ``mixture`` among them; what is left
            out is as the environment has it by itself.
        lanes: number of environments.

    Raises:
        TypeError, ValueError: for what cannot be made.
    """
    mode = AutoresetMode.SAME_STEP.value
    if environment.is_integ_environment(env_id):
        return gym.make_vec(  # type: ignore[return-value]
            env_id, lanes, vectorization_mode="vector_entry_point", autoreset_mode=mode, **arguments
        )
    varied = (*DISCRETIZATION, "mixture")
    common = {name: x for name, x in arguments.items() if name not in varied}
    stated = {n: x for n, x in arguments.items() if n in DISCRETIZATION and x is not None}
    testbed = find_testbed(env_id, common)
    if arguments.get("mixture") is not None:
        return _make_mixed(testbed, stated, arguments["mixture"], lanes, mode)
    asked = Discretization(**{**testbed.home.arguments(), **stated})
    return make_checked(testbed, asked, lanes, autoreset_mode=mode)
