"""The plant as an integrator sees it: forces assembled, losses and speed limit attached."""

from __future__ import annotations

from ..arithmetic.ops import Component, Components, Ops
from ..plants.interface import Plant
from .contact import Stops
from .friction import Friction


class PlantSystem:
    """A plant at a constant control, with its stops and friction, and an optional speed limit.

    Args:
        plant: the continuous-time plant.
        max_speed: largest magnitude of each velocity component, rad/s or m/s, or None.
        engine_stops: whether the stops are left to the engine.

    Attributes:
        stops: the plant's stops, or None where there are none of ours.
        engine_stops: the plant's stops where the engine has them act by its own law, else None.
        steep: whether there are stops or friction.
        kinked: whether there are stops.
        no_losses: zero of every loss component: (damping,), or (damping, contact) with stops of
            either kind.
    """

    def __init__(
        self, plant: Plant, max_speed: Component | None = None, engine_stops: bool = False
    ) -> None:
        self.plant = plant
        self.max_speed = max_speed
        stops: Stops | None = getattr(plant, "stops", None)
        self.stops = None if engine_stops else stops
        self.engine_stops = stops if engine_stops else None
        self.kinked = self.stops is not None
        self.no_losses: Components = (0.0,) if stops is None else (0.0, 0.0)
        self._friction: Friction | None = getattr(plant, "dry_friction", None)
        self.steep = self.stops is not None or self._friction is not None
        self._before = (0.0,) * plant.actuated
        self._after = (0.0,) * (len(plant.coordinates) - plant.actuated - 1)
        self._jacobian = getattr(plant, "jacobian", None)

    def generalized(self, control: Component) -> Components:
        """The control as a generalized force, one entry per coordinate."""
        return (*self._before, control, *self._after)

    def rates(
        self, ops: Ops, q: Components, v: Components, control: Component
    ) -> tuple[Components, Components]:
        """Accelerations and the power of each loss component, W."""
        force = self.generalized(control)
        plant = self.plant
        if not self.steep:
            return plant.acceleration(ops, q, v, force), (plant.dissipation(ops, q, v),)
        force, losses = self._resisted(ops, q, v, force)
        return plant.acceleration(ops, q, v, force), losses

    def slopes(
        self, ops: Ops, q: Components, v: Components, control: Component
    ) -> tuple[tuple[Components, ...], tuple[Components, ...]] | None:
        """(∂a/∂q, ∂a/∂v) of the plant with its stops and friction, or None if it gives none."""
        if self._jacobian is None:
            return None
        force = self.generalized(control)
        if not self.steep:
            return self._jacobian(ops, q, v, force)  # type: ignore[no-any-return]
        force, _ = self._resisted(ops, q, v, force)
        by_q, by_v = self._jacobian(ops, q, v, force)
        for j, (force_by_q, force_by_v) in enumerate(self._force_slopes(ops, q, v)):
            response = self._response(ops, q, v, j)
            by_q = _column_added(by_q, j, response, force_by_q)
            by_v = _column_added(by_v, j, response, force_by_v)
        return by_q, by_v

    def limit(self, ops: Ops, v: Components) -> Components:
        """``v`` with each component within ±max_speed."""
        if self.max_speed is None:
            return v
        return tuple([ops.maximum(-self.max_speed, ops.minimum(x, self.max_speed)) for x in v])

    def clearance(self, ops: Ops, q: Components, v: Components) -> tuple[Component, Component]:
        """Distance from the nearer stop, m or rad, negative in contact, and its rate."""
        assert self.stops is not None
        return self.stops.clearance(ops, q, v)

    def energy(self, ops: Ops, q: Components, v: Components) -> Component:
        """Energy of the plant and of its stops, J."""
        if self.stops is None:
            return self.plant.energy(ops, q, v)
        return self.plant.energy(ops, q, v) + self.stops.contact(ops, q, v).energy

    def confined(self, ops: Ops, q: Components) -> Components:
        """``q`` between the stops, ours or the engine's."""
        stops = self.engine_stops if self.stops is None else self.stops
        return q if stops is None else stops.confined(ops, q)

    def resistance(self, ops: Ops, q: Components, v: Components) -> tuple[Components, Components]:
        """Generalized forces of friction and stops, and the power of each loss component by them.

        The plant's own damping is not among them.
        """
        force: Components = (0.0,) * len(v)
        rubbed: Component = 0.0
        if self._friction is not None:
            force = self._friction.forces(ops, v)
            for x, f in zip(v, force, strict=True):
                rubbed = rubbed - f * x
        if self.stops is None:
            return force, (rubbed, *self.no_losses[1:])
        contact = self.stops.contact(ops, q, v)
        i = self.stops.coordinate
        force = (*force[:i], force[i] + contact.force, *force[i + 1 :])
        return force, (rubbed, contact.dissipated)

    def _resisted(
        self, ops: Ops, q: Components, v: Components, force: Components
    ) -> tuple[Components, Components]:
        """Force with friction and contact, and the power of each loss component."""
        resisting, losses = self.resistance(ops, q, v)
        total = tuple([a + b for a, b in zip(force, resisting, strict=True)])
        return total, (self.plant.dissipation(ops, q, v) + losses[0], *losses[1:])

    def _force_slopes(self, ops: Ops, q: Components, v: Components) -> list[Components]:
        """(∂F_j/∂q_j, ∂F_j/∂v_j) of friction and contact, for each coordinate j."""
        by_v = (0.0,) * len(v) if self._friction is None else self._friction.slopes(ops, v)
        slopes: list[Components] = [(0.0, slope) for slope in by_v]
        if self.stops is not None:
            i = self.stops.coordinate
            contact_by_q, contact_by_v = self.stops.slopes(ops, q, v)
            slopes[i] = (contact_by_q, slopes[i][1] + contact_by_v)
        return slopes

    def _response(self, ops: Ops, q: Components, v: Components, j: int) -> Components:
        """Accelerations per unit of force on coordinate ``j``: they are affine in the force."""
        none = (0.0,) * len(v)
        unit = (*none[:j], 1.0, *none[j + 1 :])
        pushed = self.plant.acceleration(ops, q, v, unit)
        free = self.plant.acceleration(ops, q, v, none)
        return tuple([a - b for a, b in zip(pushed, free, strict=True)])


def _column_added(
    matrix: tuple[Components, ...], j: int, response: Components, slope: Component
) -> tuple[Components, ...]:
    """``matrix`` with ``response`` times ``slope`` added to its column ``j``."""
    return tuple(
        (*row[:j], row[j] + a * slope, *row[j + 1 :])
        for row, a in zip(matrix, response, strict=True)
    )
