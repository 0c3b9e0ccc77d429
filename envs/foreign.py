"""Environments of others with their discretization stated, single and as a vector environment."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from operator import attrgetter, itemgetter
from typing import Any, Final, Literal, NamedTuple, cast

import gymnasium as gym
import numpy as np
import numpy.typing as npt
from gymnasium import spaces, wrappers
from gymnasium.envs.registration import EnvSpec
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.wrappers import TimeLimit

from integ_gym.support.errors import InputError, InputTypeError
from integ_gym.support.optional import running_version
from integ_gym.support.parameters import check_values, units, unknown_name

from .delayed import Delayed, SplitDelayed
from .environment import at_bounds, within_rounding
from .lanes import DTYPES, DiscretizedVectorEnv, as_floats, mask_names
from .settings import (
    DELAYS,
    LATENCIES,
    TOLERANCE,
    Discretization,
    Mixture,
    Settings,
    Timing,
    delays_in,
    timing_of,
    whole_multiple,
)
from .starts import MEMBER, stream_of_episode
from .transition import AWAY, NOT_REPORTED

_SECONDS = ("dt", "control_period", "duration")


class Further(NamedTuple):
    """A number that evidence records of every control step: its name, SI unit and meaning."""

    name: str
    unit: str
    meaning: str


FURTHER = "further"
"""Entry of `info` that holds them, in the order of the plant."""


@dataclass(frozen=True)
class ForeignPlant:
    """Names and units of controls and state, which is empty where it is not known."""

    name: str
    controls: tuple[tuple[str, str], ...]
    """Name and unit of each."""
    coordinates: tuple[str, ...] = ()
    coordinate_units: tuple[str, ...] = ()
    velocities: tuple[str, ...] = ()
    velocity_units: tuple[str, ...] = ()
    frame: str = "not known"
    further: tuple[Further, ...] = ()
    """What else is recorded of every control step."""


@dataclass(frozen=True)
class ForeignTask:
    """What is asked, as far as evidence distinguishes it."""

    goal: str
    observation_names: tuple[str, ...]
    observation_units: tuple[str, ...]
    discrete: int | None = None
    goal_stay: float = 0.0


@dataclass(frozen=True)
class ForeignSetup:
    """The counterpart of :class:`integ_gym.envs.settings.Setup`."""

    settings: Settings
    timing: Timing
    plant: ForeignPlant
    task: ForeignTask
    engine: Any
    action_space: spaces.Space[Any]
    environment: tuple[tuple[str, Any], ...]
    """Arguments of the environment."""
    fingerprinted: str | None = None
    """The plant on which the integrator's fingerprint is taken; None: it is known by name alone."""
    testbed: str | None = None
    """What made the environment, ``"module:Class"``; None: not a testbed."""

    def arguments(self) -> dict[str, Any]:
        """Discretization and arguments."""
        chosen = ("engine", "integrator", *_SECONDS)
        return {**{n: getattr(self.settings, n) for n in chosen}, **dict(self.environment)}

    def units(self) -> dict[str, str]:
        """SI unit of every argument; empty where it is not stated."""
        known = units(self.settings)
        stated = (*_SECONDS, *DELAYS)
        return {name: known[name] if name in stated else "" for name in self.arguments()}


SURVIVAL = "not terminated within the time limit"
"""Success where no return is asked for, in words."""

ENDS_AT_GOAL = (
    "Acrobot", "BipedalWalker", "BipedalWalkerHardcore", "CarRacing", "LunarLander",
    "LunarLanderContinuous", "MountainCar", "MountainCarContinuous", "lqr.lqr_2_1", "lqr.lqr_6_2",
)  # fmt: skip
"""Tasks that terminate when their goal is reached, by name without version: Gymnasium's, and
dm_control's by domain and task."""


def wrappers_of(env: gym.Env[Any, Any]) -> Iterator[gym.Wrapper[Any, Any, Any, Any]]:
    """The wrappers around an environment, the outermost first."""
    while isinstance(env, gym.Wrapper):
        yield env
        env = env.env


def time_limit(env: gym.Env[Any, Any]) -> int | None:
    """Steps after which an environment truncates an episode; None without a limit.

    Read from the `TimeLimit` wrappers around it, and from its spec where there are none.
    """
    limits = [one._max_episode_steps for one in wrappers_of(env) if isinstance(one, TimeLimit)]
    if limits:
        return min(limits)
    return env.spec.max_episode_steps if env.spec else None


def keep_duration(env: gym.Env[Any, Any], stretch: float) -> None:
    """Change the time limit of an environment whose decisions last longer, so that seconds stay.

    Args:
        env: changed.
        stretch: its control period over the one that the limit is meant for.
    """
    for one in wrappers_of(env):
        if isinstance(one, TimeLimit):
            decisions = one._max_episode_steps / stretch
            one._max_episode_steps = max(1, math.ceil(decisions * (1.0 - TOLERANCE)))


def return_of_success(wanted: float | None, spec: EnvSpec | None) -> float | None:
    """The return that is a success; None: an episode succeeds if it is not terminated.

    A task that ends at its goal is not solved by lasting until the time limit. There, the
    `reward_threshold` of its registration is the return that is a success. It is known to end at
    its goal by its name (:data:`ENDS_AT_GOAL`), or by a negative `reward_threshold`: time costs
    reward there.

    Args:
        wanted: the return that was asked for, if one was.
        spec: of the environment, as Gymnasium registers it.

    Raises:
        ValueError: for a task that ends at its goal and has no `reward_threshold`.
    """
    if wanted is not None or spec is None:
        return wanted
    threshold = spec.reward_threshold
    if spec.name not in ENDS_AT_GOAL:
        return threshold if threshold is not None and threshold < 0.0 else None
    if threshold is None:
        raise InputError(
            f"{spec.name} ends at its goal, so lasting until the time limit is no success, and it "
            "has no `reward_threshold`; say which return is a success: --success-return R with "
            "evaluate, --env-arg success_return=R with train, success_return = R under "
            "[environment] of a panel"
        )
    return threshold


class ReturnGoal:
    """Success by survival until the time limit, or by a return.

    Args:
        wanted: the return that is a success; None: survival is.

    Attributes:
        since: since when in the episode it has been met, s; `AWAY` while it is not.
    """

    def __init__(self, wanted: float | None) -> None:
        self._wanted = wanted
        self.begin()

    @property
    def words(self) -> str:
        """What success is."""
        return SURVIVAL if self._wanted is None else f"return of at least {self._wanted:g}"

    def begin(self) -> None:
        """Start an episode."""
        self._return = 0.0
        self.since = 0.0 if self._wanted is None else AWAY

    def note(self, reward: float, terminated: bool, truncated: bool, time: float) -> bool:
        """Take in a step that ends at ``time``, s; whether the episode has ended in success."""
        self._return += reward
        if self._wanted is None:
            self.since = AWAY if terminated else 0.0
        elif self._return < self._wanted:
            self.since = AWAY
        elif self.since < 0.0:
            self.since = time
        return (terminated or truncated) and self.since >= 0.0


ASSUMED_RATE = "rate, which nobody said"
"""What a record says where rewards were taken for rates by default."""


@dataclass(frozen=True)
class StatedEngine:
    """What advances it, by the name of its package."""

    package: str
    width: int | None = None
    reports: bool = False
    rewards: str | None = None
    """What a step's rewards are taken for, where a decision has several; None: not known here."""
    stretch: float = 1.0
    """Control period over the task's own, by which a decision's reward is multiplied."""
    accounted: bool = False
    """Whether the ledger knows every loss where no constraint acts."""
    solver_tolerance: float | None = None
    solver_cap: int | None = None
    model: Mapping[str, Any] = field(default_factory=dict)
    """Description of the model, as plain data."""

    @property
    def version(self) -> str:
        """The package's version."""
        return running_version(self.package)

    def solver(self) -> dict[str, Any]:
        """Tolerance and iteration cap of its solver; empty where nothing is known of it."""
        if self.solver_cap is None:
            return {}
        return {"solver_tolerance": self.solver_tolerance, "solver_cap": self.solver_cap}

    def describe(self) -> dict[str, Any]:
        """What is known of float width, losses and rewards."""
        width = {} if self.width is None else {"width": self.width}
        rewards = {} if self.rewards is None else {"rewards": self.rewards}
        stretch = {} if self.stretch == 1.0 else {"reward_factor": self.stretch}
        return {**width, "losses_accounted": self.accounted, **rewards, **stretch, **self.model}


def _rewards(env: gym.Env[Any, Any]) -> str | None:
    if not env.has_wrapper_attr("rewards_assumed"):
        return None
    assumed = env.get_wrapper_attr("rewards_assumed")
    return ASSUMED_RATE if assumed else str(env.get_wrapper_attr("rewards"))


def flat_observations(env: gym.Env[Any, Any]) -> gym.Env[Any, Any]:
    """An environment whose dictionaries of observations are one array, in their order."""
    parts = env.observation_space
    if not isinstance(parts, spaces.Dict) or not all(
        isinstance(part, spaces.Box) for part in parts.values()
    ):
        return env
    flat: Any = wrappers.FlattenObservation(env)
    flat.names_of_observation = part_names({name: part.shape or () for name, part in parts.items()})
    return cast("gym.Env[Any, Any]", flat)


def observation_names(env: gym.Env[Any, Any]) -> tuple[str, ...]:
    """Names of the numbers of its observations."""
    if env.has_wrapper_attr("names_of_observation"):
        names: tuple[str, ...] = env.get_wrapper_attr("names_of_observation")
        return names
    return tuple(f"obs{index}" for index in range(math.prod(env.observation_space.shape or (1,))))


def part_names(shapes: Mapping[str, tuple[int, ...]]) -> tuple[str, ...]:
    """Names of the numbers of an observation: a part's own, or that and a number each.

    Raises:
        ValueError: if two are the same.
    """
    sizes = {name: math.prod(shape) for name, shape in shapes.items()}
    names = tuple(
        name if size == 1 else f"{name}{index}"
        for name, size in sizes.items()
        for index in range(size)
    )
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise InputError(f"two numbers of an observation are called {twice[0]!r}; rename a part")
    return names


def describe_setup(
    env: gym.Env[Any, Any],
    applied: Discretization,
    goal: str,
    arguments: Mapping[str, Any],
    stretch: float = 1.0,
) -> ForeignSetup:
    """What is known of an environment.

    Args:
        env: with a time limit.
        applied: its discretization.
        goal: success in words.
        arguments: that it was made with.
        stretch: factor of its rewards.

    Raises:
        TypeError: for spaces of another kind than `Box`, and `Discrete` actions.
        ValueError: without a time limit.
    """
    action, observation = env.action_space, env.observation_space
    if not isinstance(observation, spaces.Box) or not isinstance(
        action, (spaces.Box, spaces.Discrete)
    ):
        raise InputTypeError(
            f"a testbed's environment must have a Box of observations and a Box or Discrete of "
            f"actions, got {observation} and {action}"
        )
    limit = time_limit(env)
    if limit is None:
        raise InputError(
            f"{type(env.unwrapped).__name__} has no time limit, so its episodes may never end; "
            "wrap it in gymnasium.wrappers.TimeLimit"
        )
    period = applied.control_period
    delays: dict[str, Any] = {**delays_in(arguments)}
    check_values(Settings, delays)
    discrete = int(action.n) if isinstance(action, spaces.Discrete) else None
    count = 1 if discrete is not None else int(np.prod(action.shape or (1,)))
    names = observation_names(env)
    settings = Settings(
        **applied.arguments(), duration=limit * period, start="the environment's own", **delays
    )
    return ForeignSetup(
        settings=settings,
        timing=timing_of(settings),
        plant=ForeignPlant(
            getattr(env.unwrapped, "title", type(env.unwrapped).__name__),
            tuple((f"action{k}", "") for k in range(count))
        ),
        task=ForeignTask(goal, names, ("",) * len(names), discrete),
        engine=StatedEngine(applied.engine, rewards=_rewards(env), stretch=stretch),
        action_space=action,
        environment=tuple(sorted(arguments.items())),
    )  # fmt: skip


Rewards = Literal["rate", "sum", "last"]

REWARDS: Final = ("rate", "sum", "last")
"""What the rewards of an environment's steps may be; see :class:`Repeated`."""

_COUNTS = (
    "counts steps, of which a finer `dt` has more; put it around what `held` returns, where a step "
    "is a decision"
)
COUNTS_DECISIONS: Final = (
    "counts decisions, which take another time there; keep the control period that it was made for"
)
"""Why a wrapper that counts is refused where decisions take another time."""
_LEARNS = (
    "keeps statistics of all steps so far, so that an episode depends on those before it; give "
    "fixed numbers to a TransformObservation or TransformReward"
)
_REFUSED: Final = {
    wrappers.AtariPreprocessing: _COUNTS,
    wrappers.Autoreset: "starts the next episode by itself; leave it out",
    wrappers.DelayObservation: _COUNTS,
    wrappers.FrameStackObservation: _COUNTS,
    wrappers.MaxAndSkipObservation: _COUNTS,
    wrappers.NormalizeObservation: _LEARNS,
    wrappers.NormalizeReward: _LEARNS,
    wrappers.RepeatAction: _COUNTS,
    wrappers.StickyAction: _COUNTS,
    wrappers.TimeAwareObservation: _COUNTS,
}
"""Wrappers that would mean something else at another step: why, and what helps."""


class Repeated(gym.Wrapper[Any, Any, Any, Any], gym.utils.RecordConstructorArgs):
    """Each action is applied for ``count`` steps, so that a finer step has the same decisions.

    What a decision pays depends on what the rewards of the steps are:

    - ``"rate"``: reward per unit of time, the same whatever the step is, as -1 for every step on
      the way. A decision pays their mean.
    - ``"sum"``: amounts, such as a cost that is scaled by the step or a bonus for an event. A
      decision pays their sum.
    - ``"last"``: a value of the state that is reached. A decision pays that of its last step.

    In each, the reward of the step that ends the episode counts whole. At another control period
    than the task's own, means and values of a state are multiplied by the ratio of the periods, so
    that returns are per second of simulated time.

    Args:
        env: whose step is one integration step.
        count: steps of a decision.
        rewards: what its rewards are; None: not stated, and they are taken for rates.
        stretch: control period over the task's own.

    Attributes:
        rewards_assumed: whether it is assumed what the rewards are.

    Raises:
        ValueError: for other rewards.
    """

    def __init__(
        self,
        env: gym.Env[Any, Any],
        count: int,
        rewards: Rewards | None = None,
        stretch: float = 1.0,
    ) -> None:
        if rewards is not None and rewards not in REWARDS:
            raise InputError(unknown_name("meaning of rewards", rewards, REWARDS))
        gym.utils.RecordConstructorArgs.__init__(
            self, count=count, rewards=rewards, stretch=stretch
        )
        super().__init__(env)
        self.count, self._stretch = count, stretch
        self.rewards: Rewards = rewards or "rate"
        self.rewards_assumed = rewards is None

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Advance one decision, or until the episode ends."""
        earned, ended = 0.0, False
        for _ in range(self.count):
            observation, reward, terminated, truncated, info = self.env.step(action)
            last, ended = float(reward), bool(terminated or truncated)
            if ended:
                break
            earned += last
        if self.rewards == "last":
            earned = last if ended else self._stretch * last
        elif self.rewards == "sum":
            earned += last if ended else 0.0
        else:
            earned = self._stretch * earned / self.count + (last if ended else 0.0)
        return observation, earned, terminated, truncated, info


def with_delays(env: gym.Env[Any, Any], setup: ForeignSetup) -> gym.Env[Any, Any]:
    """An environment with the delays of its setup; it may be changed.

    They are counted in integration steps where a decision's steps are taken one by one, by
    :class:`Repeated`, and else in decisions. An environment that has ``earlier``, see
    :class:`~.delayed.SplitDelayed`, is given its commands by integration steps.

    Args:
        env: one step is one decision.
        setup: of it.

    Raises:
        ValueError: for a delay that is no whole number of such steps, with the nearest two.
    """
    delays = delays_in(vars(setup.settings))
    if not any(delays.values()):
        return env
    inner = next((one for one in wrappers_of(env) if isinstance(one, Repeated)), None)
    if inner is not None:
        inner.env = Delayed(inner.env, setup.timing)
        return env
    period = setup.timing.control_period
    within = bool(setup.timing.delay[1] or setup.timing.jitter)
    split = within and hasattr(env.unwrapped, "earlier")
    for name in ("observation_latency",) if split else LATENCIES:
        whole_multiple(name, delays[name], "control_period", period, least=0)
    if split:
        return SplitDelayed(env, setup.timing)
    return Delayed(env, timing_of(replace(setup.settings, dt=period)))


def check_wrappers(what: str, chain: Iterable[gym.Env[Any, Any]], counts: str = _COUNTS) -> None:
    """Refuse wrappers that would mean something else at another step or control period.

    Args:
        what: cannot keep them, as the beginning of a sentence.
        chain: the wrappers.
        counts: what one that counts does, and what helps.

    Raises:
        ValueError: naming the first.
    """
    for one in chain:
        for kind, reason in _REFUSED.items():
            if isinstance(one, kind):
                name, why = type(one).__name__, counts if reason is _COUNTS else reason
                raise InputError(f"{what} cannot keep the wrapper {name}: it {why}")


def without_time_limit(env: gym.Env[Any, Any]) -> gym.Env[Any, Any]:
    """An environment without its `TimeLimit`, all other wrappers kept; it is changed.

    Raises:
        ValueError: for a wrapper that would mean something else at another step, by its name.
    """
    chain = list(wrappers_of(env))
    check_wrappers("`held`", chain)
    others = [one for one in chain if not isinstance(one, wrappers.TimeLimit)]
    inner = chain[-1].env if chain else env
    for one in reversed(others):
        one.env = inner
        inner = cast("gym.Env[Any, Any]", one)
    return inner


Array = npt.NDArray[np.float64]


class ForeignWrapper(gym.Wrapper[Any, Any, Any, Any], gym.utils.RecordConstructorArgs):
    """What wrappers around environments of others have in common.

    Attributes:
        setup: timing, names and units, for evidence.
    """

    setup: ForeignSetup
    _goal: ReturnGoal
    _steps = 0

    @property
    def fresh(self) -> bool:
        """Whether no step has been taken since the last reset."""
        return self._steps == 0

    @property
    def _time(self) -> float:
        return self._steps * self.setup.timing.control_period

    def _common_info(
        self, asked: Array, applied: Array, saturated: bool, fell_back: bool, success: bool
    ) -> dict[str, Any]:
        """Entries of `info` that are known of every environment, with each control."""
        numbers = (*asked.tolist(), *applied.tolist())
        return {
            "time": self._time,
            "saturated": saturated,
            "fallback_used": fell_back,
            "sensor_time": max(0.0, self._time - self.setup.settings.observation_latency),
            "goal_since": self._goal.since,
            "success": success,
            **dict(zip(self._control_entries, numbers, strict=True)),
        }

    @cached_property
    def _control_entries(self) -> list[str]:
        """Names in ``info`` of the controls, as commanded and as applied."""
        names = [name for name, _ in self.setup.plant.controls]
        return [f"{name}_{what}" for what in ("commanded", "applied") for name in names]


class StatedEnv(ForeignWrapper):
    """An environment whose discretization is stated, with success and time in ``info``.

    Commands and observations are late by the delays among the arguments; see :func:`with_delays`.
    Energy, work and losses are left out: they are not known. Actions are brought into the action
    space; in place of one that is not finite the last one holds, at first the one nearest to 0.

    Args:
        env: with a time limit; one step is one decision.
        applied: its discretization, read back from it.
        success_return: an episode succeeds if its return reaches this; None: if it is not
            terminated, or, where the task ends at its goal, by its `reward_threshold`.
        arguments: that it was made with, for evidence.
        stretch: its control period over the task's own. A decision's reward is multiplied by it, so
            that returns are per second of simulated time, unless :class:`Repeated` did it.

    Attributes:
        state_components: nothing: the state is not known.
    """

    state_components: tuple[float, ...] = ()
    final_state: tuple[float, ...] = ()
    status_code = final_status = NOT_REPORTED

    def __init__(
        self,
        env: gym.Env[Any, Any],
        applied: Discretization,
        success_return: float | None = None,
        arguments: Mapping[str, Any] | None = None,
        stretch: float = 1.0,
    ) -> None:
        gym.utils.RecordConstructorArgs.__init__(
            self,
            applied=applied,
            success_return=success_return,
            arguments=arguments,
            stretch=stretch,
        )
        env = flat_observations(env)
        super().__init__(env)
        keep_duration(env, stretch)
        self._goal = ReturnGoal(return_of_success(success_return, env.spec))
        self._factor = 1.0 if env.has_wrapper_attr("rewards_assumed") else stretch
        self.setup = describe_setup(env, applied, self._goal.words, arguments or {}, stretch)
        self.env = with_delays(env, self.setup)
        late = (one for one in wrappers_of(self) if isinstance(one, Delayed))
        self._delayed = next(late, None)
        space = self.action_space
        if isinstance(space, spaces.Box):
            self._ends = within_rounding(space.low.ravel(), space.high.ravel())
        self._control = self._nearest(np.zeros(len(self.setup.plant.controls)))

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Start an episode."""
        observation, info = self.env.reset(seed=seed, options=options)
        self._steps = 0
        self._goal.begin()
        self._control = self._nearest(np.zeros(len(self.setup.plant.controls)))
        return observation, {**info, **self._info(False, False, False)}

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Advance one decision."""
        asked = as_floats(action).ravel()
        valid = bool(np.isfinite(asked).all())
        space: Any = self.action_space
        discrete = isinstance(space, gym.spaces.Discrete)
        if discrete:
            saturated = valid and bool((self._nearest(asked) != asked).any())
        else:
            saturated = valid and at_bounds(asked, self._ends)
        self._control = control = self._nearest(asked if valid else self._control)
        action = int(control[0]) if discrete else control.reshape(space.shape).astype(space.dtype)
        observation, reward, terminated, truncated, info = self.env.step(action)
        self._steps += 1
        if self._factor != 1.0:
            reward = self._factor * float(reward)
        success = self._goal.note(float(reward), bool(terminated), bool(truncated), self._time)
        known = self._info(saturated, not valid, success)
        return observation, reward, bool(terminated), bool(truncated), {**info, **known}

    def _nearest(self, control: Array) -> Array:
        """The nearest action of the space, as numbers."""
        space: Any = self.action_space
        if isinstance(space, gym.spaces.Discrete):
            return np.clip(np.rint(control), space.start, space.start + space.n - 1)
        return np.clip(control, space.low.ravel(), space.high.ravel())

    def _info(self, saturated: bool, fell_back: bool, success: bool) -> dict[str, Any]:
        late = self._delayed
        acting = self._control if late is None else as_floats(late.acting).ravel()
        return self._common_info(self._control, acting, saturated, fell_back, success)


class MixedEnv(gym.Wrapper[Any, Any, Any, Any]):
    """One lane of a mixture: every episode runs on the member that it draws at its reset.

    Members are drawn as in integ-gym's own environments. The first episode after a seed is that of
    its member alone with this seed. Every later one has a seed of its own, made of the lane's seed
    and the episode's number: so starts depend neither on the members drawn nor on how long earlier
    episodes were. ``info["mixture_index"]`` tells which member it is.

    Args:
        members: an environment for each, as :class:`SequentialVectorEnv` takes them.
        mixture: their setups and shares.

    Attributes:
        setup: of the member that the episode runs on; the others of :class:`SequentialVectorEnv`
            likewise.
    """

    setup = property(attrgetter("env.setup"))
    state_components = property(attrgetter("env.state_components"))
    status_code = property(attrgetter("env.status_code"))
    fresh = property(attrgetter("env.fresh"))

    def __init__(self, members: Sequence[Any], mixture: Mixture) -> None:
        super().__init__(members[0])
        for kind in ("observation_space", "action_space"):
            first, *others = (getattr(member, kind) for member in members)
            for other in others:
                if other != first:
                    raise InputError(
                        f"members of `mixture` must have the same `{kind}`, got {first} and "
                        f"{other}; leave one out"
                    )
        self.mixture, self._members = mixture, members
        self._seeded: np.random.Generator | None = None
        self._episode = self._member = 0

    @property
    def np_random_seed(self) -> Any:
        """The lane's seed, of which each episode's is made; None before the first."""
        seeds: Any = None if self._seeded is None else self._seeded.bit_generator.seed_seq
        return None if seeds is None else seeds.entropy

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Start an episode on a member."""
        self.final_state, self.final_status = self.state_components, self.status_code
        if seed is not None or self._seeded is None:
            self._seeded, self._episode = np.random.default_rng(seed), 0
        else:
            self._episode += 1
        stream = stream_of_episode(self._seeded, MEMBER, self._episode)
        self._member = self.mixture.member(stream.random())
        self.env = self._members[self._member]
        own = int(stream.integers(2**31)) if seed is None else seed
        observation, info = self.env.reset(seed=own, options=options)
        return observation, {**info, "mixture_index": self._member}

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Advance one control period of the member's."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        return observation, reward, terminated, truncated, {**info, "mixture_index": self._member}

    def close(self) -> None:
        """Close all members."""
        for member in self._members:
            member.close()


_UNKNOWN = dict.fromkeys(
    (
        *("energy", "actuator_work", "dissipated", "clip_loss", "energy_residual"),
        *("solver_iterations", "solver_residual"),
    ),
    math.nan,
)
"""What an environment may leave out of ``info``."""


class SequentialVectorEnv(SyncVectorEnv[Any, Any], DiscretizedVectorEnv):
    """Environments of one kind, advanced one after the other.

    What one leaves out of ``info`` because it is not known is NaN here, and masked. Each has a
    ``setup`` (timing, names and units, for evidence), ``state_components`` (the true state, SI
    units), ``status_code`` (the solver's, of the last control step), both as they were before the
    last reset in ``final_state`` and ``final_status``, and ``fresh``: whether no step has been
    taken since the last reset. :class:`StatedEnv` is one.

    Args:
        make: makes one of them.
        num_envs: how many.
        autoreset_mode: an `AutoresetMode` or its value. With ``DISABLED``, a lane that has ended
            rests until it is reset.
    """

    def __init__(
        self,
        make: Callable[[], gym.Env[Any, Any]],
        num_envs: int,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
    ) -> None:
        super().__init__([make] * num_envs, autoreset_mode=autoreset_mode)
        self._tasks: list[Any] = list(self.envs)
        self._told: list[dict[str, Any]] = [{}] * num_envs
        self.spec = self.envs[0].spec
        one = self._tasks[0]
        self.mixture = one.mixture if isinstance(one, MixedEnv) else Mixture((one.setup,))
        self.setups = self.mixture.setups
        self.setup = self.setups[0]

    @property
    def state(self) -> npt.NDArray[np.float64]:
        """See :class:`DiscretizedVectorEnv`; shape (num_envs, 0) where the state is not known."""
        return np.array([task.state_components for task in self._tasks])

    @property
    def state_components(self) -> npt.NDArray[np.float64]:
        """See :class:`DiscretizedVectorEnv`."""
        return np.array([task.state_components for task in self._tasks]).T

    @property
    def status_codes(self) -> npt.NDArray[np.int64]:  # type: ignore[override]
        """See :class:`DiscretizedVectorEnv`."""
        same_step = self.autoreset_mode is AutoresetMode.SAME_STEP
        codes = [t.final_status if same_step and t.fresh else t.status_code for t in self._tasks]
        return np.array(codes)

    @property
    def final_state(self) -> npt.NDArray[np.float64]:  # type: ignore[override]
        """See :class:`DiscretizedVectorEnv`."""
        return np.array([task.final_state for task in self._tasks])

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """Advance every lane by one control period."""
        if self.autoreset_mode is not AutoresetMode.DISABLED:
            return super().step(actions)
        ended, self._rewards = self._terminations | self._truncations, np.zeros(self.num_envs)
        for lane in np.flatnonzero(~ended).tolist():
            result = self.envs[lane].step(actions[lane])
            self._env_obs[lane], self._rewards[lane] = result[:2]
            self._terminations[lane], self._truncations[lane], self._told[lane] = result[2:]
        observations = np.array(self._env_obs, dtype=self.observation_space.dtype)
        ends = self._terminations.copy(), self._truncations.copy()
        return observations, self._rewards, *ends, self._join(self._told)

    def close_extras(self, **kwargs: Any) -> None:
        """Close every lane and let go of it: their records need no models."""
        super().close_extras(**kwargs)
        self.envs, self._tasks = (), []  # type: ignore[assignment]

    def _join(self, lane_infos: list[dict[str, Any]]) -> dict[str, Any]:
        """What all lanes tell, as :meth:`_add_info` has it, many times as fast."""
        every = [{**_UNKNOWN, **info} for info in lane_infos]
        names, kinds = every[0].keys(), (*DTYPES, np.generic, np.ndarray)
        alike = all(isinstance(value, kinds) for value in every[0].values())
        if not alike or any(own.keys() != names for own in every):
            infos: dict[str, Any] = {}
            for lane, info in enumerate(lane_infos):
                infos = self._add_info(infos, info, lane)
            return infos
        columns = zip(names, zip(*map(itemgetter(*names), every), strict=True), strict=True)
        infos = {n: np.array(column, DTYPES.get(type(column[0]))) for n, column in columns}
        masks = dict.fromkeys(mask_names(tuple(names)), np.ones(self.num_envs, dtype=bool))
        for name in _UNKNOWN:
            masks[f"_{name}"] = np.array([name in info for info in lane_infos])
        return {**infos, **masks}

    def _add_info(
        self, vector_infos: dict[str, Any], env_info: dict[str, Any], env_num: int
    ) -> dict[str, Any]:
        """What Gymnasium's does; what is not known is no 0."""
        missing = [n for n in _UNKNOWN if "time" in env_info and n not in env_info]
        infos = super()._add_info(
            vector_infos, env_info | dict.fromkeys(missing, math.nan), env_num
        )
        for name in missing:
            infos[f"_{name}"][env_num] = False
        return infos
