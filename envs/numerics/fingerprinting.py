"""What an engine's integrator really is, measured from outside."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields, replace
from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt

from ..maps.lookup import map_names
from ..mechanics.system import PlantSystem
from ..plants.interface import Plant, join_state
from ..registries import PLANTS
from .matching import Case, Match, cases_of, match
from .order import ROUNDING, convergence
from .phase_space import volume_defect
from .probe import fastest_rate, probe_state
from .stepping import SINGLE_WIDTH, WIDTH, advance_lanes, engine_of, jacobian, one_step

Array = npt.NDArray[np.float64]

STEP = 0.02
"""Step at which an engine is examined, s."""

STRIDE = 0.25
"""Step times fastest rate at which it is compared with the known maps: the best of them differ by
more than rounding there, and all implicit ones can be solved for."""

DAMPING = 0.3
"""Damping of every joint in the damped cases, N m s/rad or N s/m."""

IDENTICAL = {64: 1e-9, 32: 2e-6}
"""Defect up to which a step is a map's, by the width of the engine's floats."""

SPAN = 2.0
"""Duration times fastest rate over which the order is measured."""

SINGLE_ROUNDING = 3e-5
"""Errors of an engine in float32 below this share of the state's size are its arithmetic."""


@dataclass(frozen=True)
class Fingerprint:
    """The one-step map that an engine applies to a plant, measured.

    Attributes:
        engine: its name.
        version: of the engine.
        integrator: as the engine calls it.
        plant: the plant that was moved, with its default parameters.
        width: bits of the engine's floats.
        dt: step of all but the comparison with the known maps, s.
        matching_dt: step of that comparison, s.
        map: the known map that is nearest over all cases; of several that it cannot be told from on
            this plant, the one that it is said to be.
        equal_maps: those.
        defects: largest error of one step against that map, relative to 1 + |value|, without and
            with control and damping; of steps whose solver converges, where there are any.
        runner_up: the next map in that order, and its defect over all cases.
        volume_defect: det ∂(q₁, p₁)/∂(q₀, p₀) - 1 without damping.
        order: of convergence; None: exact to the engine's rounding, or to what it is asked for.
        frequency_shift: relative change of the frequency of small oscillations.
        energy_rate: relative change of the energy of small oscillations, 1/s.
    """

    engine: str
    version: str
    integrator: str
    plant: str
    width: int
    dt: float
    matching_dt: float
    map: str
    equal_maps: tuple[str, ...]
    defects: dict[str, float]
    runner_up: tuple[str, float]
    volume_defect: float
    order: float | None
    frequency_shift: float
    energy_rate: float

    def to_json(self) -> dict[str, Any]:
        """As plain data."""
        return asdict(self)


@cache
def fingerprint(engine: str, integrator: str, plant: str = "pendulum") -> Fingerprint:
    """Measure what an engine's integrator does to a plant; once in a process.

    Args:
        engine: a registered name.
        integrator: as the engine calls it.
        plant: a registered name.

    Raises:
        ValueError: for an unknown name, or a plant that the engine does not move.
        ModuleNotFoundError: if the engine is not installed.

    >>> found = fingerprint("native", "rk4")
    >>> found.map, round(found.order, 1), found.defects["damped"] == 0.0
    ('rk4', 4.0, True)
    """
    method = f"{engine}/{integrator}"
    free = PLANTS.load(plant)()
    damped = replace(free, **dict.fromkeys(damping_parameters(free), DAMPING))
    made = engine_of(method, PlantSystem(free), STEP)
    groups = {
        "free": (free, False),
        "controlled": (free, True),
        "damped": (damped, False),
        "damped_controlled": (damped, True),
    }
    start = probe_state(free)
    names, stride = (*map_names(), "reference"), STRIDE / fastest_rate(free, start)
    matches = {
        name: _matched(method, moved, stride, cases_of(moved, controlled), names)
        for name, (moved, controlled) in groups.items()
    }
    overall = {
        name: max(m.defects[name] for m in matches.values()) for name in matches["free"].defects
    }
    said = getattr(made, "map", integrator)
    limit = IDENTICAL[made.width]
    ranked = sorted(overall, key=lambda n: (overall[n] > limit, n != said, overall[n]))
    equal = tuple(n for n in ranked if overall[n] <= limit)
    width = WIDTH if made.width == 64 else SINGLE_WIDTH
    shift, rate = _small_oscillations(method, free, width)
    return Fingerprint(
        engine=engine,
        version=made.version,
        integrator=integrator,
        plant=plant,
        width=made.width,
        dt=STEP,
        matching_dt=stride,
        map=ranked[0],
        equal_maps=equal,
        defects={name: m.defects[ranked[0]] for name, m in matches.items()},
        runner_up=(ranked[1], overall[ranked[1]]),
        volume_defect=volume_defect(method, free, start, STEP, width=width),
        order=None if "reference" in equal else _order(method, free, start, made.width),
        frequency_shift=shift,
        energy_rate=rate,
    )


def _matched(
    method: str, plant: Plant, dt: float, cases: Sequence[Case], names: Sequence[str]
) -> Match:
    """Comparison with the known maps, from where the engine's solver converges."""
    taken = one_step(method, plant, dt)
    solved = [case for case in cases if math.isfinite(taken(*case)[1][0])]
    return match(taken, plant, dt, solved or cases, names)


def _order(method: str, plant: Plant, start: Array, width: int) -> float | None:
    """Order of convergence from a state; None where errors are rounding alone."""
    frequency = fastest_rate(plant, start)
    rounding = ROUNDING if width == 64 else SINGLE_ROUNDING
    span = SPAN / frequency
    return convergence(method, plant, start, span, frequency=frequency, rounding=rounding).order


def _small_oscillations(method: str, plant: Plant, width: float) -> tuple[float, float]:
    """Relative frequency shift, and relative change of energy per second, about hanging at rest."""
    n = len(plant.coordinates)
    hanging = tuple(math.pi if name == "theta" else 0.0 for name in plant.coordinates)
    rest = np.array(join_state(hanging, (0.0,) * n))
    exact = fastest_rate(plant, rest)
    slopes = jacobian(lambda points: advance_lanes(method, plant, points, STEP), rest, width)
    swinging = max(np.linalg.eigvals(slopes), key=lambda value: abs(value.imag))
    return (
        float(abs(np.angle(swinging)) / (STEP * exact) - 1.0),
        float(2.0 * np.log(abs(swinging)) / STEP),
    )


def damping_parameters(plant: Any) -> list[str]:
    """Names of the viscous damping of the plant's joints."""
    names = (f.name for f in fields(plant))
    return [n for n in names if n.endswith("damping") and not n.startswith("stop")]
