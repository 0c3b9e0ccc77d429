"""What an integrator is on a plant, measured and declared."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields, replace
from functools import cache, lru_cache
from typing import Any

import numpy as np

from ..engines.maps import map_names, one_step_map
from ..ops.ops import SCALAR, Component, Components, join_state
from ..plants.interface import Plant, controls_of
from ..plants.pendulum import Pendulum
from ..plants.system import PlantSystem
from ..registries import INTEGRATORS, PLANTS
from . import stepping
from .accuracy import (
    ROUNDING,
    convergence,
    reversibility_errors,
    symplecticity_defect,
    volume_defect,
)

ORDER_TOLERANCE = 0.05
"""A measured order this far from the declared one contradicts it."""

SYMPLECTIC = 1e-9
"""max |JᵀΩJ − Ω| below which a step is symplectic."""

REVERSIBLE = 1e-9
"""Forward-backward error below which a motion is reversible; rounding may grow on the way."""

STEP = 0.5
"""Step times fastest rate at which symplecticity and reversibility are examined."""

SPAN = 2.0
"""Duration times fastest rate over which the order is measured."""

STEPS = 50
"""Steps of the way out."""


@dataclass(frozen=True)
class Declared:
    """What an integrator's class says of itself; None where it says nothing."""

    order: int | None
    symplectic: bool | None
    reversible: bool | None


@dataclass(frozen=True)
class Identity:
    """What an integrator was measured to be on a plant.

    Attributes:
        order: of convergence; None: exact to rounding; NaN: it diverges.
        symplectic: whether one step preserves the canonical form in (q, M(q) v). A method that is
            exact to rounding does, whatever its construction. None of a plant with massless
            coordinates, which have no momenta.
        reversible: whether going forward, turning round and coming back returns to the start. None
            of a plant with massless coordinates, for a lag does not turn round.
        stable_up_to: largest hω on the harmonic oscillator; 0: never stable, ``inf``: always.
        symplecticity_defect: max |JᵀΩJ − Ω|.
        reversibility_errors: |state − start| in state order and SI units.
        dt: step of the last two, s.
        order_steps: steps over which the order was measured, s.
    """

    order: float | None
    symplectic: bool | None
    reversible: bool | None
    stable_up_to: float
    symplecticity_defect: float
    reversibility_errors: tuple[float, ...]
    dt: float
    order_steps: tuple[float, ...]

    def contradictions(self, declared: Declared) -> tuple[str, ...]:
        """Names of the declared properties that the measurement contradicts.

        A method that is exact to rounding contradicts nothing.
        """
        if self.order is None:
            return ()
        found = []
        if declared.order is not None and not abs(self.order - declared.order) <= ORDER_TOLERANCE:
            found.append("order")
        for name in ("symplectic", "reversible"):
            said, measured = getattr(declared, name), getattr(self, name)
            if None not in (said, measured) and said != measured:
                found.append(name)
        return tuple(found)


def declared(integrator: str) -> Declared:
    """Order, symplecticity and reversibility as an integrator's class states them.

    Args:
        integrator: a registered name or ``"module:Class"``.

    Raises:
        ValueError: for an unknown integrator.
    """
    owner = INTEGRATORS.load(integrator)
    names = ("order", "symplectic", "reversible")
    return Declared(*(getattr(owner, name, None) for name in names))


def classify(
    integrator: str,
    plant: Plant | None = None,
    state: stepping.State | None = None,
    follow: stepping.Advance = stepping.advance,
) -> Identity:
    """Measure order, symplecticity, reversibility and linear stability.

    Args:
        integrator: a registered name or ``"module:Class"``.
        plant: with numbers as parameters; None: Gymnasium's pendulum.
        state: where it is examined, shape (n,), in state order; None: away from rest.
        follow: what takes the steps of order and reversibility.

    Raises:
        ValueError: for an unknown integrator.

    >>> found = classify("stormer_verlet")
    >>> round(found.order, 2), found.symplectic, found.reversible, round(found.stable_up_to, 6)
    (2.0, True, True, 2.0)
    """
    plant = Pendulum() if plant is None else plant
    start = stepping.probe_state(plant) if state is None else state
    rate = stepping.fastest_rate(plant, start)
    dt, massless = STEP / rate, bool(getattr(plant, "massless", ()))
    canonical = math.nan if massless else symplecticity_defect(integrator, plant, start, dt)
    errors = reversibility_errors(integrator, plant, start, dt, STEPS * dt, follow=follow)
    measured = convergence(integrator, plant, start, SPAN / rate, frequency=rate, follow=follow)
    return Identity(
        order=measured.order,
        symplectic=None if massless else canonical < SYMPLECTIC,
        reversible=None if massless else bool(errors.max() < REVERSIBLE),
        stable_up_to=stepping.stability_limit(integrator),
        symplecticity_defect=canonical,
        reversibility_errors=tuple(errors.tolist()),
        dt=dt,
        order_steps=measured.steps_s,
    )


Case = tuple[Components, Components, Component]
"""(q, v, control): where a step begins; of several controls a tuple of them."""


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
    step: stepping.OneStep,
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
    drawn = rng.uniform(-spread, spread, (count, 2 * n + len(plant.controls)))
    drawn[:, 2 * n :] *= controlled
    parts = ((row[:n], row[n : 2 * n], row[2 * n :]) for row in drawn.tolist())
    return [(tuple(q), tuple(v), tuple(u) if len(u) > 1 else u[0]) for q, v, u in parts]


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
    controls = controls_of(plant, control)
    system, known = PlantSystem(plant, max_speed), one_step_map(name)
    try:
        for _ in range(substeps):
            end = known.step(SCALAR, system, q, v, system.no_losses, controls, dt)
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


FINGERPRINT_STEP = 0.02
"""Step at which an engine is examined, s."""

STRIDE = 0.25
"""Step times fastest rate at which it is compared with the known maps: the best of them differ by
more than rounding there, and all implicit ones can be solved for."""

DAMPING = 0.3
"""Damping of every joint in the damped cases, N m s/rad or N s/m."""

IDENTICAL = {64: 1e-9, 32: 2e-6}
"""Defect up to which a step is a map's, by the width of the engine's floats."""

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
        map: the known map that is nearest over all cases; of several that this plant does
            not distinguish, the one that it is said to be.
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
def fingerprint(
    engine: str,
    integrator: str,
    plant: str = "pendulum",
    solver: tuple[tuple[str, Any], ...] = (),
) -> Fingerprint:
    """Measure what an engine's integrator does to a plant; once in a process.

    Args:
        engine: a registered name.
        integrator: as the engine calls it.
        plant: a registered name.
        solver: settings of the engine's solver that are not its defaults, as pairs.

    Raises:
        ValueError: for an unknown name, or a plant that the engine does not move.
        ModuleNotFoundError: if the engine is not installed.

    >>> found = fingerprint("native", "rk4")
    >>> found.map, round(found.order, 1), found.defects["damped"] == 0.0
    ('rk4', 4.0, True)
    """
    method = f"{engine}/{integrator}" + (f" {json.dumps(dict(solver))}" if solver else "")
    free = PLANTS.load(plant)()
    damped = replace(free, **dict.fromkeys(damping_parameters(free), DAMPING))
    stepper = stepping.engine_of(method, PlantSystem(free), FINGERPRINT_STEP)
    groups = {
        "free": (free, False),
        "controlled": (free, True),
        "damped": (damped, False),
        "damped_controlled": (damped, True),
    }
    start = stepping.probe_state(free)
    names, stride = (*map_names(), "reference"), STRIDE / stepping.fastest_rate(free, start)
    matches = {
        name: _match_converged(method, moved, stride, cases_of(moved, controlled), names)
        for name, (moved, controlled) in groups.items()
    }
    overall = {
        name: max(m.defects[name] for m in matches.values()) for name in matches["free"].defects
    }
    said = getattr(stepper, "map", integrator)
    limit = IDENTICAL[stepper.width]
    ranked = sorted(overall, key=lambda n: (overall[n] > limit, n != said, overall[n]))
    equal = tuple(n for n in ranked if overall[n] <= limit)
    width = stepping.WIDTH if stepper.width == 64 else stepping.SINGLE_WIDTH
    shift, rate = _small_oscillations(method, free, width)
    return Fingerprint(
        engine=engine,
        version=stepper.version,
        integrator=integrator,
        plant=plant,
        width=stepper.width,
        dt=FINGERPRINT_STEP,
        matching_dt=stride,
        map=ranked[0],
        equal_maps=equal,
        defects={name: m.defects[ranked[0]] for name, m in matches.items()},
        runner_up=(ranked[1], overall[ranked[1]]),
        volume_defect=volume_defect(method, free, start, FINGERPRINT_STEP, width=width),
        order=None if "reference" in equal else _order(method, free, start, stepper.width),
        frequency_shift=shift,
        energy_rate=rate,
    )


def _match_converged(
    method: str, plant: Plant, dt: float, cases: Sequence[Case], names: Sequence[str]
) -> Match:
    """Comparison with the known maps, from where the engine's solver converges."""
    taken = stepping.one_step(method, plant, dt)
    solved = [case for case in cases if math.isfinite(taken(*case)[1][0])]
    return match(taken, plant, dt, solved or cases, names)


def _order(method: str, plant: Plant, start: stepping.Array, width: int) -> float | None:
    """Order of convergence from a state; None where errors are rounding alone."""
    frequency = stepping.fastest_rate(plant, start)
    rounding = ROUNDING if width == 64 else SINGLE_ROUNDING
    span = SPAN / frequency
    return convergence(method, plant, start, span, frequency=frequency, rounding=rounding).order


def _small_oscillations(method: str, plant: Plant, width: float) -> tuple[float, float]:
    """Relative frequency shift, and relative change of energy per second, about hanging at rest."""
    n = len(plant.coordinates)
    hanging = tuple(math.pi if name == "theta" else 0.0 for name in plant.coordinates)
    rest = np.array(join_state(hanging, (0.0,) * n))
    exact = stepping.fastest_rate(plant, rest)
    slopes = stepping.jacobian(
        lambda points: stepping.advance_lanes(method, plant, points, FINGERPRINT_STEP), rest, width
    )
    swinging = max(np.linalg.eigvals(slopes), key=lambda value: abs(value.imag))
    return (
        float(abs(np.angle(swinging)) / (FINGERPRINT_STEP * exact) - 1.0),
        float(2.0 * np.log(abs(swinging)) / FINGERPRINT_STEP),
    )


def damping_parameters(plant: Any) -> list[str]:
    """Names of the viscous damping of the plant's joints."""
    names = (f.name for f in fields(plant))
    return [n for n in names if n.endswith("damping") and not n.startswith("stop")]
