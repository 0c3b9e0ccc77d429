"""What is told of environments that are not made of our plants and tasks, as we tell of our own."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
from gymnasium import spaces
from gymnasium.envs.registration import EnvSpec
from gymnasium.wrappers import TimeLimit

from ..episode.control_period import AWAY
from ..episode.settings import Settings
from ..episode.timing import Timing

_SECONDS = ("dt", "control_period", "duration")


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


@dataclass(frozen=True)
class ForeignTask:
    """What is asked, as far as it is told apart in evidence."""

    goal: str
    observation_names: tuple[str, ...]
    observation_units: tuple[str, ...]
    discrete: int | None = None
    goal_stay: float = 0.0


@dataclass(frozen=True)
class ForeignSetup:
    """The counterpart of :class:`integ_gym.envs.episode.settings.Setup`."""

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

    def arguments(self) -> dict[str, Any]:
        """Discretization and arguments."""
        chosen = ("engine", "integrator", *_SECONDS)
        return {**{n: getattr(self.settings, n) for n in chosen}, **dict(self.environment)}

    def units(self) -> dict[str, str]:
        """SI unit of every argument; empty where it is not stated."""
        return {name: "s" if name in _SECONDS else "" for name in self.arguments()}


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
        raise ValueError(
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
