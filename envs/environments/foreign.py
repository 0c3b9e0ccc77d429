"""What is told of environments that are not made of our plants and tasks, as we tell of our own."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from gymnasium import spaces

from ..episode import AWAY, Settings, Timing

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
        wanted = self._wanted
        survival = "not terminated within the time limit"
        return survival if wanted is None else f"return of at least {wanted:g}"

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
