"""What is known of an episode before it is played: run, policy, cell and phase."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from integ_gym.envs.settings import DISCRETIZATION, agrees
from integ_gym.support.errors import InputError

from .fields import PHASES
from .labels import Home, Replays

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
        home_known: whether that tells all; False for a policy of which nobody says where it was
            trained, so that no failure is put down to its discretization or to anything else.
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
