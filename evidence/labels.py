"""What is known of an episode beside its steps, and why it failed: labels, reasons, sentences."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import Any, Literal, NamedTuple

from integ_gym.envs.settings import DISCRETIZATION, agrees
from integ_gym.support.errors import InputError
from integ_gym.support.terminal import percent

from .fields import PHASES, in_words, json_text
from .schema import parse_field

Home = bool | Literal["is home", "no home"] | None

SATURATED = 0.5
"""Share of saturated control steps from which saturation counts as the reason."""

LEARNED = 0.5
"""Share of its starts at home from which a policy counts as one that has learned."""


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
        contract_kept: whether observation, command, force and acceleration are those of home at the
            same states, before any integration; None: not compared.
    """

    home: Home = None
    without_noise: bool | None = None
    without_delay: bool | None = None
    second_horizon: bool | None = None
    home_success: float | None = None
    cell_status: str | None = None
    contract_kept: bool | None = None

    def columns(self) -> dict[str, Any]:
        """Fields of a record by name."""
        said = {column: getattr(self, name) for name, column in REPLAY_COLUMNS.items()}
        return said if isinstance(self.home, bool) else {**said, "replay_home": None}


_OF_REPLAYS = ("home", "without_noise", "without_delay", "second_horizon")

REPLAY_COLUMNS = {
    own.name: f"replay_{own.name}" if own.name in _OF_REPLAYS else own.name
    for own in fields(Replays)
}
"""What :class:`Replays` says, to the fields of a record that hold it."""


@dataclass(frozen=True)
class EpisodeFacts:
    """What the rules look at.

    Attributes:
        success: whether the metric was met; None where that is not known.
        time: length of the episode, s; None where that is not known.
        episode_return: sum of rewards, or None if it is not finite.
        solver_status: worst status.
        saturated_share: share of saturated control steps.
        goal_reached: first time at the goal, s, or None.
        goal_left: last time the goal was left, s, or None.
        goal_since: start of the stay in which the episode ended, s, or None.
        observation_noise: standard deviation of the sensor noise, SI units.
        staleness: action latency, and age that a sample can have at a decision, s.
        homes: number of the policy's training discretizations.
    """

    success: bool | None
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


_COURSE = "it {course}"
_SUCCEEDS = "the same policy succeeds from the same start"

REASONS = {
    "diverged": "the simulation diverged at {time:.4g} s on {discretization}",
    "return_not_finite": "the return is not finite{after}",
    "success_unknown": "{goal}; the return is {return:.6g}",
    "succeeded": "succeeded: {goal}{since}",
    "contract_differs": "observation, command, force or acceleration at once differ from those at "
    f"home, so the discretization is not blamed; {_COURSE}",
    "cell_unachievable": "a search over controls misses the goal's energy here from most starts, "
    f"in twice the time too; {_COURSE}",
    "not_learned_at_home": "the policy succeeds from {percentage:.3g} % of its starts at home; "
    + _COURSE,
    "succeeds_in_twice_the_time": f"{_SUCCEEDS} in twice the time; {_COURSE}",
    "home_not_replayed": f"the replay {{home}} was not run; {_COURSE}",
    "noise_not_replayed": f"the replay without observation noise was not run; {_COURSE}",
    "delay_not_replayed": f"the replay without latency and staleness was not run; {_COURSE}",
    "succeeds_at_home": f"{_SUCCEEDS} {{home}}, but on {{discretization}} {{course}}",
    "succeeds_without_noise": f"{_SUCCEEDS} without observation noise, but with standard "
    "deviation {observation_noise:.4g} {course}",
    "succeeds_without_delay": f"{_SUCCEEDS} without delays, but with {{staleness:.4g}} s of "
    "latency and staleness {course}",
    "saturated": _COURSE,
    "left_goal": _COURSE,
    "reached_goal_late": _COURSE,
    "never_reached_goal": _COURSE,
}
"""Codes of the reasons that records hold, each with its sentence; see :func:`failure_sentence`."""

SENTENCE_COLUMNS = (
    "failure_reason", "failure_numbers", "metric_definition", "engine", "integrator", "dt",
    "control_period", "terminated",
)  # fmt: skip
"""Fields of a record that :func:`failure_sentence` looks at."""


class Failure(NamedTuple):
    """A label, with the code and the numbers of its reason.

    Attributes:
        label: one of :data:`integ_gym.evidence.fields.LABELS`.
        reason: one of :data:`REASONS`.
        numbers: of the reason, by name, in SI units; without those that are not known.
    """

    label: str
    reason: str
    numbers: dict[str, float]

    def columns(self) -> dict[str, str]:
        """Fields of a record by name."""
        return {
            "failure_label": self.label,
            "failure_reason": self.reason,
            "failure_numbers": json_text(self.numbers),
        }


def failure_label(facts: EpisodeFacts, replays: Replays) -> Failure:
    """Label and reason of an episode: the first rule that fits."""
    label, reason, numbers = _find_rule(facts, replays)
    return Failure(label, reason, {k: x for k, x in numbers.items() if x is not None})


def _find_rule(facts: EpisodeFacts, replays: Replays) -> tuple[str, str, dict[str, Any]]:
    if facts.solver_status == "diverged":
        return "evaluation_error", "diverged", {"time": facts.time}
    if facts.episode_return is None:
        return "evaluation_error", "return_not_finite", {"time": facts.time}
    if facts.success is None:
        return "unattributed", "success_unknown", {"return": facts.episode_return}
    if facts.success:
        return "none", "succeeded", {"since": facts.goal_since}
    course = {
        "time": facts.time,
        "saturated_share": facts.saturated_share,
        "reached": facts.goal_reached,
        "left": facts.goal_left,
    }
    if replays.contract_kept is False:
        return "contract_error", "contract_differs", course
    if replays.cell_status == "unachievable":
        return "unachievable", "cell_unachievable", course
    home = replays.home_success
    if home is not None and home < LEARNED:
        return "not_learned", "not_learned_at_home", {**course, "home_success": home}
    if replays.second_horizon:
        return "too_slow", "succeeds_in_twice_the_time", course
    noise, staleness = facts.observation_noise, facts.staleness
    rules: list[tuple[str, str, bool | None, dict[str, float]]] = []
    if not isinstance(replays.home, str):
        rules.append(("discretization_error", "home", replays.home, {"homes": facts.homes}))
    if noise:
        numbers = {"observation_noise": noise}
        rules.append(("perception_error", "noise", replays.without_noise, numbers))
    if staleness:
        rules.append(("state_error", "delay", replays.without_delay, {"staleness": staleness}))
    for label, condition, replay, numbers in rules:
        if replay is None:
            return "unattributed", f"{condition}_not_replayed", {**course, **numbers}
        if replay:
            how = "at" if condition == "home" else "without"
            return label, f"succeeds_{how}_{condition}", {**course, **numbers}
    if facts.saturated_share >= SATURATED:
        return "control_error", "saturated", course
    if facts.goal_left is not None:
        return "control_error", "left_goal", course
    never = facts.goal_reached is None
    return "planning_error", "never_reached_goal" if never else "reached_goal_late", course


def lacks_home(fields: Mapping[str, Any]) -> bool:
    """Whether a record's label could not be found without a replay at home."""
    reasons = ("home_not_replayed", "the replay on its training discretization was not run")
    return str(fields["failure_reason"]).startswith(reasons)


def failure_sentence(fields: Mapping[str, Any]) -> str:
    """Why an episode ended as it did, in a sentence with numbers.

    Args:
        fields: of a record, :data:`SENTENCE_COLUMNS` at least; one of schema version 4 and before
            holds the sentence itself.
    """
    reason = fields["failure_reason"]
    if fields.get("failure_numbers") is None:
        return str(reason or "")
    numbers = parse_field("failure_numbers", fields["failure_numbers"])
    time, since, homes = (numbers.get(name) for name in ("time", "since", "homes"))
    many = homes is not None and homes > 1
    sentence = REASONS[reason].format(
        **numbers
        | {"after": "" if time is None else f" after {time:.4g} s"}
        | {"since": "" if since is None else f", at the goal from {since:.4g} s on"},
        goal=fields["metric_definition"],
        discretization=in_words(fields),
        percentage=100.0 * numbers.get("home_success", 0.0),
        home="on a training discretization of it" if many else "on its training discretization",
        course=_describe_course(fields, numbers) if "saturated_share" in numbers else "",
    )
    return f"{sentence}."


def _describe_course(fields: Mapping[str, Any], numbers: Mapping[str, float]) -> str:
    """What happened, as the rest of a sentence."""
    goal, time = fields["metric_definition"], numbers["time"]
    reached, left = numbers.get("reached"), numbers.get("left")
    saturated = f"with {percent(numbers['saturated_share'])} of the control steps saturated"
    if reached is None:
        return f"never reached the goal ({goal}) in {time:.4g} s, {saturated}"
    if fields["terminated"] and (reached, left) == (0.0, time):
        return f"was terminated at {time:.4g} s (asked: {goal}), {saturated}"
    arrived = f"came to the goal ({goal}) at {reached:.4g} s"
    if left is not None:
        return f"{arrived} and last left it at {left:.4g} s, {saturated}"
    return f"{arrived}, too late for the episode's end at {time:.4g} s, {saturated}"


Stated = Mapping[str, Any]
"""Some of ``engine``, ``integrator``, ``dt`` (s) and ``control_period`` (s)."""


@dataclass(frozen=True)
class EpisodeContext:
    """What the environment cannot know about its episodes.

    Attributes:
        run_id: the run that the episodes belong to.
        cell: key of the panel cell or of the training run.
        phase: one of :data:`integ_gym.evidence.fields.PHASES`.
        policy_id: name of the policy.
        policy_hash: hash of everything that decides its actions.
        training_discretization: what the policy was trained on, or a list for a mixture; None for
            a policy that was not trained, or of which this is not known.
        home_known: whether that is all there is to know; False for a policy whose training is
            unknown, so that no failure is attributed to its discretization or to anything else.
        training_seed: seed of its training.
        perturbation: plant parameters changed in this cell.
        first_episode: index of the first episode where episodes are counted.
        trace_every: episodes whose index is a multiple of it have a trace.
        replays: what replays said, for all episodes; see also ``commit`` of the recorder.
        inference_latency_mean: mean time of a decision at batch size 1, ns.
        inference_latency_p99: 99th percentile of the same, ns.
        float_width: bits of the numbers that the physics is computed with; None: not known.
        packages: versions of further packages that matter, such as the trainer's.

    Raises:
        ValueError: for an unknown phase or discretization key, or a ``trace_every`` below 1.
    """

    run_id: str
    cell: str
    phase: str = "evaluation"
    policy_id: str = ""
    policy_hash: str = ""
    training_discretization: Stated | Sequence[Stated] | None = None
    home_known: bool = True
    training_seed: int | None = None
    perturbation: Mapping[str, Any] | None = None
    first_episode: int = 0
    trace_every: int = 1
    replays: Replays = field(default_factory=Replays)
    inference_latency_mean: float | None = None
    inference_latency_p99: float | None = None
    float_width: int | None = 64
    packages: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.phase not in PHASES:
            raise InputError(f"`phase` must be one of {', '.join(PHASES)}, got {self.phase!r}")
        if self.trace_every < 1:
            raise InputError(f"`trace_every` must be 1 or above, got {self.trace_every}")
        for member in self.homes:
            unknown = sorted(set(member) - set(DISCRETIZATION))
            if unknown or not member:
                raise InputError(
                    f"`training_discretization` must have some of "
                    f"{', '.join(DISCRETIZATION)}, got {dict(member)!r}"
                )

    @property
    def homes(self) -> tuple[Stated, ...]:
        """The training discretizations."""
        given = self.training_discretization
        if given is None:
            return ()
        return (given,) if isinstance(given, Mapping) else tuple(given)

    def home(self, episode: Mapping[str, Any]) -> Home:
        """Whether an episode with these fields ran at home; None if a replay must tell.

        Keys that the training discretization does not state are not compared.
        """
        known = episode["engine"] is not None
        if self.phase == "training" or (known and any(agrees(h, episode) for h in self.homes)):
            return "is home"
        return None if self.homes or not self.home_known else "no home"

    def has_trace(self, episode_index: int) -> bool:
        """Whether the episode's trace is kept."""
        return episode_index % self.trace_every == 0

    def record_id(self, episode_index: int) -> str:
        """Hash of cell, policy and episode index, 32 hexadecimal digits."""
        return hashlib.sha256(b"%s, %d]" % (self._identity, episode_index)).hexdigest()[:32]

    @cached_property
    def _identity(self) -> bytes:
        """JSON of cell, policy and perhaps phase, to be followed by the episode index."""
        own = [self.cell, self.policy_id, self.policy_hash]
        if self.phase not in ("training", "evaluation"):
            own.append(self.phase)
        return json.dumps(own).encode()[:-1]
