"""Numbers that may decide what a policy loses on the truth, and what people go by."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final, NamedTuple

import numpy as np

from .quantities import Quantities


class Term(NamedTuple):
    """A part of a loss, and the number that it goes by.

    Attributes:
        part: ``whole``, or one of the two kinds that add up: ``out of step`` and ``helped``.
        number: nondecreasing in what is expected of it.
        name: of the number.
    """

    part: str
    number: Callable[[Quantities], float]
    name: str


def _whole(numbers: Mapping[str, Callable[[Quantities], float]]) -> dict[str, tuple[Term, ...]]:
    """Numbers that the whole loss goes by, by name."""
    return {name: (Term("whole", number, name),) for name, number in numbers.items()}


CANDIDATES: Final[Mapping[str, tuple[Term, ...]]] = {
    **_whole(
        {
            "force of the numerics": lambda q: q.force,
            "force over time to spare": lambda q: q.force / q.time_to_spare,
            "power of the numerics": lambda q: abs(q.power),
            "energy share of the numerics": lambda q: abs(q.energy_share),
            "critical ratio": lambda q: abs(np.log(q.critical_ratio)),
            "step times fastest rate": lambda q: q.h_omega,
        }
    ),
    "reactive force, and power over time to spare": (
        Term("out of step", lambda q: q.reactive_force, "reactive force of the numerics"),
        Term(
            "helped",
            lambda q: max(q.power, 0.0) / q.time_to_spare,
            "power of the numerics over time to spare",
        ),
    ),
}
"""What may decide, by name."""

GUESSES: Final[Mapping[str, tuple[Term, ...]]] = _whole(
    {
        "step alone": lambda q: q.step,
        "order alone": lambda q: q.inverse_order,
        "spectral radius": lambda q: abs(q.growth),
        "nothing": lambda q: 0.0,
    }
)
"""What people go by, by name."""

_TERMS: Final = {**CANDIDATES, **GUESSES}


def terms_of(name: str) -> tuple[Term, ...]:
    """The terms of a candidate or a guess."""
    return _TERMS[name]
