"""Subjects that can be put into any state."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import product

import numpy as np

from integ_gym.envs import numerics
from integ_gym.envs.plants.interface import Plant

from .subject import Sample, State, Subject, Transition

COUNT = 10
"""Random states without control, and as many with."""

FAST = (7.9, 40.0)
"""Speeds at which a speed limit is looked for, rad/s or m/s."""


@dataclass(frozen=True)
class Settable:
    """Access by setting the state before each control period.

    Attributes:
        step: advances the subject by one control period.
        spread: states are drawn within ± this, SI units; inside of any stops.
        damped: the same with damping in the joints, which tells some maps apart.
        swings: whether it can go round from 90°; False where stops prevent it.
    """

    step: numerics.OneStep
    spread: float = 1.5
    damped: tuple[Plant, numerics.OneStep] | None = None
    swings: bool = True

    def samples(self, subject: Subject) -> list[Sample]:
        """From random states, half of them under random controls."""
        kinds = [(subject.plant, self.step), *([self.damped] if self.damped else [])]
        return [_taken(plant, step, self._cases(subject, plant)) for plant, step in kinds]

    def driven(self, subject: Subject) -> Sample:
        """From fast states, under the largest control in the direction of motion."""
        n = len(subject.plant.coordinates)
        still, cases = (0.0,) * (n - 1), []
        for angle, speed, sign in product((0.5, 1.5, 2.5), FAST, (1.0, -1.0)):
            case = ((*still, sign * angle), (*still, sign * speed), sign * subject.max_control)
            cases.append(_rounded(case, subject.width))
        return _taken(subject.plant, self.step, cases)

    def coast(self, subject: Subject) -> list[State] | None:
        """From 90° at rest."""
        if not self.swings:
            return None
        n = len(subject.plant.coordinates)
        state: State = (*(0.0,) * (n - 1), 0.5 * math.pi), (0.0,) * n
        states = [state]
        for _ in range(subject.coasting_steps):
            state = _end(self.step, (*state, 0.0))
            states.append(state)
        return states

    def _cases(self, subject: Subject, plant: Plant) -> list[numerics.Case]:
        scale = subject.max_control / self.spread
        return [
            _rounded((q, v, scale * control), subject.width)
            for controlled in (False, True)
            for q, v, control in numerics.cases_of(plant, controlled, COUNT, self.spread)
        ]


def _taken(plant: Plant, step: numerics.OneStep, cases: list[numerics.Case]) -> Sample:
    """The control periods that end in a finite state."""
    taken = (Transition(case, _end(step, case)) for case in cases)
    return Sample(plant, tuple(one for one in taken if np.isfinite(one.end).all()))


def _end(step: numerics.OneStep, case: numerics.Case) -> State:
    """Where a control period ends; NaN where its arithmetic fails."""
    try:
        return step(*case)
    except (ArithmeticError, ValueError):  # of a component that is not finite
        lost = (math.nan,) * len(case[0])
        return lost, lost


def _rounded(case: numerics.Case, width: int) -> numerics.Case:
    """The case as floats of that width hold it."""
    if width == 64:
        return case
    q, v, control = (np.asarray(part, dtype=np.float32).tolist() for part in case)
    return tuple(q), tuple(v), control
