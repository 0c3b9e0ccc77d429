"""Failure labels: which of the known reasons explains a failed episode."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy.typing as npt

from integ_gym.support.terminal import percent

Home = bool | Literal["is home", "no home"] | None

SATURATED = 0.5
"""Share of saturated control steps from which saturation counts as the reason."""

LEARNED = 0.5
"""Share of its starts at home from which a policy counts as one that has learned."""

_AT_HOME = "on its training discretization"


@dataclass(frozen=True)
class Replays:
    """What is known about an episode from outside it.

    Of replays, in which the same policy acts from the same start under other conditions, True: it
    succeeded; False: it failed; None: the replay was not run.

    Attributes:
        home: on the policy's training discretization; ``"is home"`` where the episode itself ran
            on it, ``"no home"`` for a policy that was not trained.
        without_noise: without observation noise.
        without_delay: without action latency and with a sample at every decision.
        second_horizon: within one duration or two.
        home_success: share of its starts from which the policy succeeds at home; None: not known.
        cell_status: one of :data:`integ_gym.evidence.fields.CELL_STATUSES`, decided without
            the policy; None: not known.
    """

    home: Home = None
    without_noise: bool | None = None
    without_delay: bool | None = None
    second_horizon: bool | None = None
    home_success: float | None = None
    cell_status: str | None = None

    def columns(self) -> dict[str, Any]:
        """Fields of a record by name."""
        return {
            "replay_home": self.home if isinstance(self.home, bool) else None,
            "replay_without_noise": self.without_noise,
            "replay_without_delay": self.without_delay,
            "replay_second_horizon": self.second_horizon,
            "home_success": self.home_success,
            "cell_status": self.cell_status,
        }


@dataclass(frozen=True)
class EpisodeFacts:
    """What the rules look at.

    Attributes:
        success: whether the metric was met; None where that is not known.
        goal: the metric in words.
        discretization: engine, integrator and step in words.
        time: length of the episode, s; None where that is not known.
        episode_return: sum of rewards, or None if it is not finite.
        solver_status: worst status.
        saturated_share: share of saturated control steps.
        goal_reached: first time at the goal, s, or None.
        goal_left: last time the goal was left, s, or None.
        goal_since: start of the stay in which the episode ended, s, or None.
        observation_noise: standard deviation of the sensor noise, SI units.
        staleness: action latency, and age that a sample can have at a decision, s.
        homes: training discretizations of the policy.
        terminated: whether the task ended the episode.
    """

    success: bool | None
    goal: str
    discretization: str
    time: float | None
    episode_return: float | None
    solver_status: str
    saturated_share: float
    goal_reached: float | None
    goal_left: float | None
    goal_since: float | None
    observation_noise: float = 0.0
    staleness: float = 0.0
    homes: int = 1
    terminated: bool = False


def failure_label(facts: EpisodeFacts, replays: Replays) -> tuple[str, str]:
    """Label and reason: the first rule that fits.

    Returns:
        One of :data:`integ_gym.evidence.fields.LABELS`, and a sentence with numbers, which
        ends with a full stop.
    """
    label, reason = _explained(facts, replays)
    return label, f"{reason}."


def lacks_home(label: str, reason: str) -> bool:
    """Whether a label was not to be found for want of a replay at the policy's only home."""
    return label == "unattributed" and reason.startswith(_not_run(_AT_HOME))


def _not_run(replayed: str) -> str:
    return f"the replay {replayed} was not run"


def _explained(facts: EpisodeFacts, replays: Replays) -> tuple[str, str]:
    if facts.solver_status == "diverged":
        broken = f"the simulation diverged at {facts.time:.4g} s on {facts.discretization}"
        return "evaluation_error", broken
    if facts.episode_return is None:
        after = "" if facts.time is None else f" after {facts.time:.4g} s"
        return "evaluation_error", f"the return is not finite{after}"
    if facts.success is None:
        return "unattributed", f"{facts.goal}; the return is {facts.episode_return:.6g}"
    if facts.success:
        since = (
            "" if facts.goal_since is None else f", at the goal from {facts.goal_since:.4g} s on"
        )
        return "none", f"succeeded: {facts.goal}{since}"
    course = _course(facts)
    beyond = _beyond(replays)
    if beyond is not None:
        label, reason = beyond
        return label, f"{reason}; it {course}"
    for rule in _rules(facts, replays):
        if rule.replay is None:
            return "unattributed", f"{_not_run(rule.replayed)}; it {course}"
        if rule.replay:
            succeeds = f"the same policy succeeds from the same start {rule.otherwise}"
            return rule.label, f"{succeeds}, but {rule.here} {course}"
    if facts.saturated_share >= SATURATED or facts.goal_left is not None:
        return "control_error", f"it {course}"
    return "planning_error", f"it {course}"


def _beyond(replays: Replays) -> tuple[str, str] | None:
    """What explains a failure by no fault of the policy in this cell."""
    if replays.cell_status == "unachievable":
        return (
            "unachievable",
            "a search over controls misses the goal's energy here from most starts, in twice the "
            "time too",
        )
    home = replays.home_success
    if home is not None and home < LEARNED:
        return "not_learned", f"the policy succeeds from {100.0 * home:.3g} % of its starts at home"
    if replays.second_horizon:
        return "too_slow", "the same policy succeeds from the same start in twice the time"
    return None


class _Rule(NamedTuple):
    """What explains a failure if a replay without it succeeded."""

    label: str
    replay: bool | None
    """What the replay said."""
    replayed: str
    otherwise: str
    here: str


def _rules(facts: EpisodeFacts, replays: Replays) -> Iterator[_Rule]:
    """The rules for which there is something to replay without."""
    if not isinstance(replays.home, str):
        home = _AT_HOME
        if facts.homes > 1:
            home = "on a training discretization of it"
        here = f"on {facts.discretization}"
        yield _Rule("discretization_error", replays.home, home, home, here)
    if facts.observation_noise:
        without = "without observation noise"
        here = f"with standard deviation {facts.observation_noise:.4g}"
        yield _Rule("perception_error", replays.without_noise, without, without, here)
    if facts.staleness:
        here = f"with {facts.staleness:.4g} s of latency and staleness"
        without = "without latency and staleness"
        yield _Rule("state_error", replays.without_delay, without, "without delays", here)


def _course(facts: EpisodeFacts) -> str:
    """What happened, as the rest of a sentence."""
    saturated = f"with {percent(facts.saturated_share)} of the control steps saturated"
    if facts.goal_reached is None:
        return f"never reached the goal ({facts.goal}) in {facts.time:.4g} s, {saturated}"
    if facts.terminated and (facts.goal_reached, facts.goal_left) == (0.0, facts.time):
        return f"was terminated at {facts.time:.4g} s (asked: {facts.goal}), {saturated}"
    reached = f"came to the goal ({facts.goal}) at {facts.goal_reached:.4g} s"
    if facts.goal_left is not None:
        return f"{reached} and last left it at {facts.goal_left:.4g} s, {saturated}"
    return f"{reached}, too late for the episode's end at {facts.time:.4g} s, {saturated}"


Array = npt.NDArray[Any]
