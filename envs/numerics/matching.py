"""Which known one-step map a step is: compared with each from many states."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from ..arithmetic.ops import SCALAR, Components
from ..maps.lookup import map_names, one_step_map
from ..mechanics.system import PlantSystem
from ..plants.interface import Plant
from .stepping import OneStep

Case = tuple[Components, Components, float]
"""(q, v, control): where a step begins."""


@dataclass(frozen=True)
class Match:
    """How far a step is from the known maps.

    Attributes:
        defects: map to the largest error of one step, relative to 1 + |value|; `inf` where the
            map fails.
    """

    defects: dict[str, float]

    @property
    def defect(self) -> float:
        """The smallest of them."""
        return min(self.defects.values())


def match(
    step: OneStep,
    plant: Plant,
    dt: float,
    cases: Sequence[Case],
    names: Sequence[str] = (),
    substeps: int = 1,
) -> Match:
    """Compare a step with the known maps.

    Args:
        step: the step in question.
        plant: what it is said to integrate, with numbers as parameters.
        dt: time that the step takes, s.
        cases: where it is compared.
        names: of the maps; by default all.
        substeps: steps of dt / substeps that the maps take.
    """
    taken = [step(*case) for case in cases]
    defects = {
        name: max(
            largest_error(got, mapped(name, plant, dt / substeps, substeps, case))
            for got, case in zip(taken, cases, strict=True)
        )
        for name in names or map_names()
    }
    return Match(defects)


def cases_of(plant: Plant, controlled: bool, count: int = 10, spread: float = 2.0) -> list[Case]:
    """States at random, with controls up to 2 N or N m or without, SI units."""
    rng, n = np.random.default_rng(20), len(plant.coordinates)
    drawn = rng.uniform(-spread, spread, (count, 2 * n + 1))
    return [
        (tuple(row[:n].tolist()), tuple(row[n:-1].tolist()), float(row[-1]) if controlled else 0.0)
        for row in drawn
    ]


def mapped(
    name: str, plant: Plant, dt: float, substeps: int, case: Case, max_speed: float | None = None
) -> tuple[Components, Components]:
    """(q, v) after some steps of a known map; `inf` where its arithmetic fails.

    Args:
        name: of the map.
        plant: with numbers as parameters.
        dt: of one step, s.
        substeps: how many.
        case: where they begin.
        max_speed: limit on each velocity, acting where the map has it act.
    """
    known: Any = plant
    return _mapped(name, known, dt, substeps, case, max_speed)


@lru_cache(maxsize=1 << 16)
def _mapped(
    name: str, plant: Any, dt: float, substeps: int, case: Case, max_speed: float | None
) -> tuple[Components, Components]:
    q, v, control = case
    system, known = PlantSystem(plant, max_speed), one_step_map(name)
    try:
        for _ in range(substeps):
            end = known.step(SCALAR, system, q, v, system.no_losses, control, dt)
            q, v = end.q, system.limit(SCALAR, end.v)
    except ArithmeticError:
        lost = (float("inf"),) * len(q)
        return lost, lost
    return q, v


def largest_error(
    got: tuple[Components, Components], expected: tuple[Components, Components]
) -> float:
    """Largest difference of two (q, v), relative to 1 + |value|; `inf` where one is not finite."""
    a, b = (np.array((*q, *v), dtype=np.float64) for q, v in (got, expected))
    with np.errstate(invalid="ignore"):
        error = np.abs(a - b) / (1.0 + np.abs(b))
    return float(error.max()) if np.isfinite(error).all() else float("inf")
