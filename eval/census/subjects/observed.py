"""Subjects whose state cannot be set: what is known of them was seen in their episodes."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, NamedTuple

from .subject import Sample, State, Subject, Transition

COUNT = 40
"""Control periods that are compared with the known maps."""

BELOW = 0.9
"""Share of a stated speed limit below which it does not act in the next control period."""

Policy = Literal["random", "driven", "zero"]
"""Random controls; the largest in the direction of motion; none."""


class Episode(NamedTuple):
    """States at the instants of control, and the controls between them."""

    states: list[State]
    controls: list[float]


@dataclass(frozen=True)
class Observed:
    """Access by watching episodes.

    Attributes:
        watch: episodes under a policy.
        has_zero: whether a control of zero can be had, and episodes last with it.
    """

    watch: Callable[[Policy], list[Episode]]
    has_zero: bool = True

    def samples(self, subject: Subject) -> list[Sample]:
        """Evenly out of episodes under random controls."""
        limit = subject.stated.max_speed
        seen = [
            one
            for one in _transitions(self.watch("random"))
            if limit is None or max(map(abs, one.case[1])) < BELOW * limit
        ]
        return [Sample(subject.plant, tuple(seen[:: max(1, len(seen) // COUNT)][:COUNT]))]

    def driven(self, subject: Subject) -> Sample:
        """The fastest out of episodes that are driven."""
        seen = _transitions(self.watch("driven"))
        seen.sort(key=lambda one: -max(map(abs, one.case[1])))
        return Sample(subject.plant, tuple(seen[:COUNT]))

    def coast(self, subject: Subject) -> list[State] | None:
        """The episode without control that begins nearest to 90° from hanging at rest."""
        if not self.has_zero:
            return None
        steps = subject.coasting_steps
        whole = [e.states for e in self.watch("zero") if len(e.states) > steps]
        return min(whole, key=_from_the_side)[: steps + 1]


def nearest_turn(angle: float, near: float) -> float:
    """The angle, known but for full turns, that is nearest to another, rad."""
    return near + math.remainder(angle - near, math.tau)


def _from_the_side(states: list[State]) -> float:
    q, v = states[0]
    return float(abs(math.cos(q[-1])) + max(map(abs, v)))


def _transitions(episodes: list[Episode]) -> list[Transition]:
    return [
        Transition((*episode.states[k], control), episode.states[k + 1])
        for episode in episodes
        for k, control in enumerate(episode.controls)
    ]
