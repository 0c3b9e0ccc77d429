r"""One impact of a plant on its stop, and what it comes to exactly.

Where nothing else acts, a mass m that meets a stop of stiffness k and damping d at speed v obeys
:math:`m \dot p\,d\dot p = -k p (1 + d\dot p)\,dp`, so that :math:`g(\dot p) + k p^2 / 2m` stays
constant, with :math:`g(v) = v/d - \ln(1 + d v)/d^2`. It goes in to :math:`p = \sqrt{2 m g(v) / k}`
and leaves at the speed u of :math:`g(-u) = g(v)`.
Source: Hunt and Crossley (1975), *Coefficient of restitution interpreted as damping in
vibroimpact*, Journal of Applied Mechanics 42, with exponent 1.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from integ_gym.envs.ops.ops import SCALAR
from integ_gym.envs.plants.interface import split_state

from .rollout import Array
from .subject import Subject

SPEED = 1.0
"""Speed of arrival, m/s or rad/s."""

LIMIT = 2.0
"""Where the stop stands, m or rad."""

_FREE = 1e-9
"""Acceleration that is none, m/s^2 or rad/s^2."""

PHASES = 16
"""Places within a step at which the stop is touched."""


@dataclass(frozen=True)
class Impact:
    """An impact without gravity and without anything that swings.

    Attributes:
        arguments: plant parameters but the stiffness.
        touching: state in which the stop is touched, state order, shape (n,).
        place: of the stopped coordinate in the state.
        unit: of the stopped coordinate.
        mass: that meets the stop, kg or kg m^2.
        stiffness: of the plant's stop by default, N/m or N m/rad.
        damping: of the stop, s/m or s/rad.
    """

    arguments: dict[str, Any]
    touching: Array
    place: int
    unit: str
    mass: float
    stiffness: float
    damping: float

    @property
    def energy(self) -> float:
        """Kinetic energy of arrival, J."""
        return 0.5 * self.mass * SPEED**2

    @property
    def stiffness_unit(self) -> str:
        """Of the stop."""
        return "N m/rad" if self.unit == "rad" else "N/m"

    def starts(self, dt: float, run_up: float, phases: int = PHASES) -> Array:
        """Starts that touch the stop at evenly spaced places within a step, shape (phases, n).

        Args:
            dt: step, s.
            run_up: time before the first touch, at least, s.
            phases: how many.
        """
        starts = np.tile(self.touching, (phases, 1))
        starts[:, self.place] -= SPEED * (run_up + dt * (np.arange(phases) + 0.5) / phases)
        return starts

    def rate(self, stiffness: float) -> float:
        """Frequency of the mass on the stop, rad/s."""
        return math.sqrt(stiffness / self.mass)

    def penetration(self, stiffness: float) -> float:
        """How deep the mass goes in, m or rad."""
        return math.sqrt(2.0 * self._spent(SPEED)) / self.rate(stiffness)

    @property
    def rebound(self) -> float:
        """Share of the kinetic energy that is left, whatever the stiffness."""
        low, high = 0.0, SPEED
        for _ in range(100):
            middle = 0.5 * (low + high)
            below = self.damping * middle < 1.0 and self._spent(-middle) < self._spent(SPEED)
            low, high = (middle, high) if below else (low, middle)
        return (low / SPEED) ** 2

    def _spent(self, speed: float) -> float:
        """g(speed), m^2/s^2."""
        d = self.damping
        if d == 0.0:
            return 0.5 * speed * speed
        return speed / d - math.log1p(d * speed) / (d * d)


def impact_of(subject: Subject) -> Impact | None:
    """The impact of a plant on its stop; None without stops, or where other forces act there."""
    plant: Any = subject.plant
    limits = subject.parameters("limit")
    described = all(hasattr(plant, n) for n in ("stopped", "stop_stiffness", "stop_damping"))
    if not described or len(limits) != 1:
        return None
    arguments = {limits[0]: LIMIT, **subject.undamped}
    if hasattr(plant, "gravity"):
        arguments["gravity"] = 0.0
    place = 2 * plant.stopped
    touching = np.zeros(len(subject.rest))
    # A pole along the track is not swung by the cart.
    turned = [i for i, unit in enumerate(plant.coordinate_units) if unit == "rad"]
    touching[[2 * i for i in turned]] = 0.5 * math.pi
    touching[place], touching[place + 1] = LIMIT, SPEED
    free, mass = _response(subject.varied(**arguments), touching, plant.stopped)
    if abs(free) > _FREE:
        return None
    return Impact(
        arguments, touching, place, plant.coordinate_units[plant.stopped], mass,
        plant.stop_stiffness, plant.stop_damping,
    )  # fmt: skip


def _response(plant: Any, state: Array, coordinate: int) -> tuple[float, float]:
    """Acceleration along a coordinate without a force, and force per acceleration."""
    q, v = split_state(tuple(state.tolist()))
    nothing = (0.0,) * len(q)
    unit = tuple(1.0 if i == coordinate else 0.0 for i in range(len(q)))
    pushed, free = (
        plant.acceleration(SCALAR, q, v, force)[coordinate] for force in (unit, nothing)
    )
    return float(free), float(1.0 / (pushed - free))
