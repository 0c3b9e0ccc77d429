"""What an integrator is on a plant, measured and declared."""

from __future__ import annotations

from dataclasses import dataclass

from ..plants.interface import Plant
from ..plants.pendulum import Pendulum
from ..registries import INTEGRATORS
from .linear import stability_limit
from .order import convergence
from .phase_space import reversibility_errors, symplecticity_defect
from .probe import fastest_rate, probe_state
from .stepping import Advance, State, advance

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
            exact to rounding does, whatever its construction.
        reversible: whether going forward, turning round and coming back returns to the start.
        stable_up_to: largest hω on the harmonic oscillator; 0: never stable, ``inf``: always.
        symplecticity_defect: max |JᵀΩJ − Ω|.
        reversibility_errors: |state − start| in state order and SI units.
        dt: step of the last two, s.
        order_steps: steps over which the order was measured, s.
    """

    order: float | None
    symplectic: bool
    reversible: bool
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
        if declared.symplectic not in (None, self.symplectic):
            found.append("symplectic")
        if declared.reversible not in (None, self.reversible):
            found.append("reversible")
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
    state: State | None = None,
    follow: Advance = advance,
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
    start = probe_state(plant) if state is None else state
    rate = fastest_rate(plant, start)
    dt = STEP / rate
    canonical = symplecticity_defect(integrator, plant, start, dt)
    errors = reversibility_errors(integrator, plant, start, dt, STEPS * dt, follow=follow)
    measured = convergence(integrator, plant, start, SPAN / rate, frequency=rate, follow=follow)
    return Identity(
        order=measured.order,
        symplectic=canonical < SYMPLECTIC,
        reversible=bool(errors.max() < REVERSIBLE),
        stable_up_to=stability_limit(integrator),
        symplecticity_defect=canonical,
        reversibility_errors=tuple(errors.tolist()),
        dt=dt,
        order_steps=measured.steps_s,
    )
