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

from integ_gym.envs.ops import SCALAR
from integ_gym.envs.plants.interface import split_state
from integ_gym.eval.diagnosis.bench import Array
from integ_gym.eval.diagnosis.subject import Subject

SPEED = 1.0
"""Speed of arrival, m/s or rad/s."""

LIMIT = 2.0
"""Where the stop stands, m or rad."""

_RUN_UP = 0.1414
"""Distance from the stop at the start, so that arrival falls between control instants."""


@dataclass(frozen=True)
class Impact:
    """An impact without gravity and without anything that swings.

    Attributes:
        arguments: plant parameters but the stiffness.
        start: state order, shape (n,).
        mass: that meets the stop, kg or kg m².
        stiffness: of the plant's stop by default, N/m or N m/rad.
        damping: of the stop, s/m or s/rad.
    """

    arguments: dict[str, Any]
    start: Array
    mass: float
    stiffness: float
    damping: float

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
        """g(speed), m²/s²."""
        d = self.damping
        if d == 0.0:
            return 0.5 * speed * speed
        return speed / d - math.log1p(d * speed) / (d * d)


def impact_of(subject: Subject) -> Impact | None:
    """The impact of a plant on its stop; None for a plant without stops."""
    plant: Any = subject.plant
    limits = subject.parameters("limit")
    described = all(hasattr(plant, n) for n in ("stopped", "stop_stiffness", "stop_damping"))
    if not described or len(limits) != 1:
        return None
    arguments = {limits[0]: LIMIT}
    if hasattr(plant, "gravity"):
        arguments["gravity"] = 0.0
    place = 2 * plant.stopped
    start = np.zeros(len(subject.rest))
    # A pole along the track is not swung by the cart.
    turned = [i for i, unit in enumerate(plant.coordinate_units) if unit == "rad"]
    start[[2 * i for i in turned]] = 0.5 * math.pi
    start[place], start[place + 1] = LIMIT - _RUN_UP, SPEED
    mass = _mass(subject.varied(**arguments), start, plant.stopped)
    return Impact(arguments, start, mass, plant.stop_stiffness, plant.stop_damping)


def _mass(plant: Any, start: Array, coordinate: int) -> float:
    """Force per acceleration along a coordinate."""
    q, v = split_state(tuple(start.tolist()))
    nothing = (0.0,) * len(q)
    unit = tuple(1.0 if i == coordinate else 0.0 for i in range(len(q)))
    pushed, free = (plant.acceleration(SCALAR, q, v, force) for force in (unit, nothing))
    return float(1.0 / (pushed[coordinate] - free[coordinate]))
