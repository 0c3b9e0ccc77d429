"""What the census looks at: something that steps a pendulum or a cart-pole."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple, Protocol

from integ_gym.envs import numerics
from integ_gym.envs.ops.ops import Components
from integ_gym.envs.plants.interface import Plant

COAST = 10.0
"""Duration of the free motion whose energy is followed, s."""

State = tuple[Components, Components]
"""(q, v), SI units."""


class Transition(NamedTuple):
    """Where one control period begins, with the control held in it, and where it ends."""

    case: numerics.Case
    end: State


@dataclass(frozen=True)
class Sample:
    """Control periods of one plant."""

    plant: Plant
    transitions: tuple[Transition, ...]

    @property
    def cases(self) -> list[numerics.Case]:
        """Where they begin."""
        return [one.case for one in self.transitions]

    @property
    def step(self) -> numerics.OneStep:
        """The step that was seen, defined on :attr:`cases` alone."""
        seen = {one.case: one.end for one in self.transitions}
        return lambda q, v, control: seen[(q, v, control)]


@dataclass(frozen=True)
class Statement:
    """What the maker says of the discretization.

    Attributes:
        control_period: time between two decisions, s.
        substeps: integration steps in one control period.
        map: the one-step map that is named, by our name for it; None where none is named.
        words: how it is named.
        max_speed: largest speed, rad/s; None: none is stated.
    """

    control_period: float
    substeps: int = 1
    map: str | None = None
    words: str = ""
    max_speed: float | None = None

    @property
    def dt(self) -> float:
        """Integration step, s."""
        return self.control_period / self.substeps


class Access(Protocol):
    """How the motion of a subject is got at."""

    def samples(self, subject: Subject) -> list[Sample]:
        """Control periods under any control, slow enough for no speed limit to act."""

    def driven(self, subject: Subject) -> Sample:
        """Control periods at the highest speeds that can be had."""

    def coast(self, subject: Subject) -> list[State] | None:
        """States at the instants of control of a free motion; None: it cannot be had.

        It lasts :data:`COAST`, and begins 90° from hanging at rest, or as near as can be had.
        """


@dataclass(frozen=True)
class Subject:
    """One line of the census.

    Attributes:
        source: engine or library.
        name: of the integrator or environment there.
        version: of the engine or library.
        published: whether it is an environment that others publish, not an engine of ours.
        plant: what it moves, with its parameters; a body of another shape as the point mass on a
            rod that moves alike.
        stated: what its maker says.
        max_control: largest control, N or N m.
        access: how its motion is got at; None of what was measured and let go.
        width: bits of the floats in which states are seen.
        note: what a reader of the line has to know.
    """

    source: str
    name: str
    version: str
    published: bool
    plant: Plant
    stated: Statement
    max_control: float
    access: Access | None = field(repr=False)
    width: int = 64
    note: str = ""

    @property
    def coasting_steps(self) -> int:
        """Control periods in the free motion."""
        return round(COAST / self.stated.control_period)
