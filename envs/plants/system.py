"""A plant with all that acts on it, its ledger, and its motion over a control period."""

from __future__ import annotations

from functools import reduce
from operator import add, or_
from typing import NamedTuple

from ..mechanics import Friction, Kink, Rates, Servo, Slopes
from ..ops.ops import Component, Components, Ops, select
from .contact import ContactPoint, Reaction, Stops
from .interface import Plant

UNLIMITED = float("inf")
"""Speed limit where there is none; a plant's file imports no arithmetic."""


class PlantSystem:
    """A plant at a constant control, with its contacts and friction, and an optional speed limit.

    Args:
        plant: the continuous-time plant.
        max_speed: largest magnitude of each velocity component, rad/s or m/s, or None: the plant's
            own limits, where it has some.
        engine_stops: whether the stops are left to the engine.
        servo: where the controls are its targets, else None.

    Attributes:
        speed_limits: largest magnitude of each velocity, or None.
        stops: the plant's stops, or None where there are none of ours.
        engine_stops: the plant's stops where the engine has them act by its own law, else None.
        contacts: the plant's contact points, with the names of its `contact_names`.
        resisted: whether there are stops, contact points or friction.
        moving: indices of the coordinates with mass.
        steep: whether there are those, or a servo within the field.
        kinked: whether there are stops or contact points.
        servo: that acts within the vector field, or None.
        sampler: the servo that is computed at the start of steps, or None.
        no_losses: zero of every loss component: that of damping, that of stops of either kind if
            there are some, (damping, friction) of every contact point; then of what is
            carried with them: where controls are more than forces along coordinates their work, J,
            and of a servo within the field the integral of each squared effort.
    """

    def __init__(
        self,
        plant: Plant,
        max_speed: Component | None = None,
        engine_stops: bool = False,
        servo: Servo | None = None,
    ) -> None:
        self.plant = plant
        self.max_speed = max_speed
        own, massless = getattr(plant, "speed_limits", None), getattr(plant, "massless", ())
        limits = own if max_speed is None else (max_speed,) * len(plant.velocities)
        self.speed_limits: Components | None = limits and tuple(  # a thrust is no speed
            [UNLIMITED if x is None or i in massless else x for i, x in enumerate(limits)]
        )
        stops: Stops | None = getattr(plant, "stops", None)
        self.stops = None if engine_stops else stops
        self.engine_stops = stops if engine_stops else None
        self.contacts: tuple[ContactPoint, ...] = getattr(plant, "contacts", ())
        self.kinked = self.stops is not None or bool(self.contacts)
        self._friction: Friction | None = getattr(plant, "dry_friction", None)
        continuous = servo is not None and servo.when == "continuous"
        self.servo = servo if continuous else None
        self.sampler = None if continuous else servo
        self.resisted = self.kinked or self._friction is not None
        self.steep = self.resisted or continuous
        self._before = (0.0,) * plant.actuated[0]
        self._after = (0.0,) * (len(plant.coordinates) - plant.actuated[0] - 1)
        self.input_forces = getattr(plant, "input_forces", None)
        self._carried = 0 if self.input_forces is None and self.servo is None else 1
        if self.servo is not None:
            self._carried += len(plant.controls)
        kinds = 1 + int(stops is not None) + 2 * len(self.contacts)
        self.no_losses: Components = (0.0,) * (kinds + self._carried)
        self._jacobian = None if self.input_forces else getattr(plant, "jacobian", None)
        self.moving = [i for i in range(len(plant.coordinates)) if i not in massless]

    def to_generalized_force(self, controls: Components) -> Components:
        """Controls as a generalized force, one entry per coordinate, of a plant where they are."""
        if len(controls) == 1:
            return (*self._before, controls[0], *self._after)
        force: list[Component] = [0.0] * len(self.plant.coordinates)
        for place, control in zip(self.plant.actuated, controls, strict=True):
            force[place] = control
        return tuple(force)

    def power(self, ops: Ops, q: Components, v: Components, controls: Components) -> Component:
        """Of the controls, W."""
        return self._power_of(self.forces(ops, q, v, controls), v)

    def _power_of(self, force: Components, v: Components) -> Component:
        return reduce(add, [force[i] * v[i] for i in self.moving])

    def work(self, controls: Components, before: Components, after: Components) -> Component:
        """Of held controls between two configurations, J, by the coordinates that they drive.

        0 where it is carried among the losses.
        """
        if self._carried:
            return 0.0
        pairs = zip(controls, self.plant.actuated, strict=True)
        return reduce(add, [u * (after[k] - before[k]) for u, k in pairs])

    def begin(self, q: Components, v: Components) -> Motion:
        """A motion of no time, with nothing booked."""
        motion = Motion(q, v, q, v, 0.0, self.no_losses, 0.0, 0, 0.0, True, True)
        motion = motion._replace(depths=(0.0,) * len(self.contacts))
        if self.servo is None and self.sampler is None:
            return motion
        none = (0.0 * q[0],) * len(self.plant.controls)
        return motion._replace(efforts=none, squares=none)

    def book_carried(self, motion: Motion) -> Motion:
        """A motion with the work and the squares that it carries among its losses as its own."""
        if not self._carried:
            return motion
        count = len(motion.losses) - self._carried
        work, *squares = motion.losses[count:]
        return motion._replace(losses=motion.losses[:count], work=work, squares=tuple(squares))

    def sample_servo(
        self, ops: Ops, motion: Motion, targets: Components, at: tuple[Component, Component]
    ) -> Components:
        """Efforts in a step: computed at its start, or at that of an earlier one and held.

        Args:
            ops: arithmetic.
            motion: so far in the control period.
            targets: of the servo.
            at: the step, from 0, and its length, s.
        """
        servo, (index, dt) = self.sampler, at
        assert servo is not None
        efforts = servo.efforts(ops, motion.q, motion.v, targets)
        if servo.when == "step":
            return efforts
        due = index % servo.steps(ops, dt) == 0
        return select(ops, due, efforts, motion.efforts)

    def at_effort_limit(self, efforts: Components) -> Component:
        """Whether the effort of some servo is at its limit."""
        servo = self.servo or self.sampler
        assert servo is not None
        pairs = zip(efforts, servo.limits, strict=True)
        return reduce(or_, [(x <= low) | (x >= high) for x, (low, high) in pairs])

    def forces(self, ops: Ops, q: Components, v: Components, controls: Components) -> Components:
        """Generalized force of the controls, one entry per coordinate."""
        if self.servo is not None:
            return self.to_generalized_force(self.servo.efforts(ops, q, v, controls))
        if self.input_forces is None:
            return self.to_generalized_force(controls)
        force: Components = self.input_forces(ops, q, v, controls)
        return force

    def rates(self, ops: Ops, q: Components, v: Components, control: Components) -> Rates:
        """Accelerations and the power of each loss component, W."""
        plant = self.plant
        if self._carried:
            force = self.forces(ops, q, v, control)
            power = self._power_of(force, v)
            squares = () if self.servo is None else [force[k] * force[k] for k in plant.actuated]
            force, losses = self._add_resistance(ops, q, v, force)
            return plant.acceleration(ops, q, v, force), (*losses, power, *squares)
        force = self.to_generalized_force(control)
        if not self.steep:
            return plant.acceleration(ops, q, v, force), (plant.dissipation(ops, q, v),)
        force, losses = self._add_resistance(ops, q, v, force)
        return plant.acceleration(ops, q, v, force), losses

    def with_resistance(
        self, ops: Ops, q: Components, v: Components, force: Components
    ) -> Components:
        """A generalized force with that of friction, of our stops and of contact points."""
        return self._add_resistance(ops, q, v, force)[0] if self.steep else force

    def slopes(self, ops: Ops, q: Components, v: Components, control: Components) -> Slopes | None:
        """(∂a/∂q, ∂a/∂v) of the plant with contact and friction, or None if it gives none."""
        if self._jacobian is None:
            return None
        force = self.forces(ops, q, v, control)
        if not self.steep:
            return self._jacobian(ops, q, v, force)  # type: ignore[no-any-return]
        force, _ = self._add_resistance(ops, q, v, force)
        by_q, by_v = self._jacobian(ops, q, v, force)
        responses = self._responses(ops, q, v)
        if self.stops is not None or self._friction is not None or self.servo is not None:
            for j, (force_by_q, force_by_v) in enumerate(self._force_slopes(ops, q, v, control)):
                by_q = _column_added(by_q, j, responses[j], force_by_q)
                by_v = _column_added(by_v, j, responses[j], force_by_v)
        for contact in self.contacts:
            columns_by_q, columns_by_v = contact.slopes(ops, q, v)
            for j, columns in enumerate(zip(columns_by_q, columns_by_v, strict=True)):
                for response, slope_by_q, slope_by_v in zip(responses, *columns, strict=True):
                    by_q = _column_added(by_q, j, response, slope_by_q)
                    by_v = _column_added(by_v, j, response, slope_by_v)
        return by_q, by_v

    def limit(self, ops: Ops, v: Components) -> Components:
        """``v`` with each component within its limit."""
        if self.speed_limits is None:
            return v
        pairs = zip(v, self.speed_limits, strict=True)
        return tuple([ops.maximum(-most, ops.minimum(x, most)) for x, most in pairs])

    def kinks(self, ops: Ops, q: Components, v: Components, control: Component) -> tuple[Kink, ...]:
        """Where the accelerations have a kink: at the nearer stop, and at contact points."""
        found: tuple[Kink, ...] = ()
        if self.stops is not None:
            found = (Kink(*self.stops.clearance(ops, q, v)),)
        if self.contacts:
            acceleration, _ = self.rates(ops, q, v, control)
            for contact in self.contacts:
                found += contact.kinks(ops, q, v, acceleration)
        return found

    def reactions(self, ops: Ops, q: Components, v: Components) -> tuple[Reaction, ...]:
        """What every contact point meets in the state (q, v)."""
        return tuple([contact.reaction(ops, q, v) for contact in self.contacts])

    def energy(self, ops: Ops, q: Components, v: Components) -> Component:
        """Energy of the plant and of what it touches, J."""
        energy = self.plant.energy(ops, q, v)
        if self.stops is not None:
            energy = energy + self.stops.contact(ops, q, v).energy
        for reaction in self.reactions(ops, q, v):
            energy = energy + reaction.touch.stored_energy
        return energy

    def confine(self, ops: Ops, q: Components) -> Components:
        """``q`` between the stops, ours or the engine's."""
        stops = self.engine_stops if self.stops is None else self.stops
        return q if stops is None else stops.confine(ops, q)

    def resistance(self, ops: Ops, q: Components, v: Components) -> tuple[Components, Components]:
        """Generalized forces of friction and contact, and the power of each loss component by them.

        The plant's own damping is not among them.
        """
        force: Components = (0.0,) * len(v)
        rubbed: Component = 0.0
        if self._friction is not None:
            force = self._friction.forces(ops, v)
            for x, f in zip(v, force, strict=True):
                rubbed = rubbed - f * x
        losses: Components = () if self.engine_stops is None else (0.0,)
        if self.stops is not None:
            contact = self.stops.contact(ops, q, v)
            i = self.stops.coordinate
            force = (*force[:i], force[i] + contact.force, *force[i + 1 :])
            losses = (contact.dissipated,)
        for reaction in self.reactions(ops, q, v):
            force = tuple([a + b for a, b in zip(force, reaction.force, strict=True)])
            losses = (*losses, reaction.damped, reaction.rubbed)
        return force, (rubbed, *losses)

    def _add_resistance(
        self, ops: Ops, q: Components, v: Components, force: Components
    ) -> tuple[Components, Components]:
        """Force with friction and contact, and the power of each loss component."""
        resisting, losses = self.resistance(ops, q, v)
        total = tuple([a + b for a, b in zip(force, resisting, strict=True)])
        return total, (self.plant.dissipation(ops, q, v) + losses[0], *losses[1:])

    def _force_slopes(
        self, ops: Ops, q: Components, v: Components, controls: Components
    ) -> list[Components]:
        """(∂F_j/∂q_j, ∂F_j/∂v_j) of friction, contact and servo, for each coordinate j."""
        by_v = (0.0,) * len(v) if self._friction is None else self._friction.slopes(ops, v)
        slopes: list[Components] = [(0.0, slope) for slope in by_v]
        if self.stops is not None:
            i = self.stops.coordinate
            contact_by_q, contact_by_v = self.stops.slopes(ops, q, v)
            slopes[i] = (contact_by_q, slopes[i][1] + contact_by_v)
        if self.servo is not None:
            for j, by_q, by_speed in self.servo.slopes(ops, q, v, controls):
                slopes[j] = (slopes[j][0] + by_q, slopes[j][1] + by_speed)
        return slopes

    def _responses(self, ops: Ops, q: Components, v: Components) -> list[Components]:
        """Accelerations per unit of force on each coordinate: they are affine in the force."""
        none = (0.0,) * len(v)
        free = self.plant.acceleration(ops, q, v, none)
        units = [(*none[:j], 1.0, *none[j + 1 :]) for j in range(len(v))]
        pushed = [self.plant.acceleration(ops, q, v, unit) for unit in units]
        return [tuple([a - b for a, b in zip(each, free, strict=True)]) for each in pushed]


def _column_added(
    matrix: tuple[Components, ...], j: int, response: Components, slope: Component
) -> tuple[Components, ...]:
    """``matrix`` with ``response`` times ``slope`` added to its column ``j``."""
    return tuple(
        (*row[:j], row[j] + a * slope, *row[j + 1 :])
        for row, a in zip(matrix, response, strict=True)
    )


class Motion(NamedTuple):
    """A plant's motion over one control period."""

    q: Components
    v: Components
    sampled_q: Components
    """Configuration at the sensor's last sample in this period, if there was one."""
    sampled_v: Components
    work: Component
    """Of the controls, J: Σ over sub-steps of each times the displacement of its coordinate."""
    losses: Components
    """Energy lost per loss component, J; see :attr:`PlantSystem.no_losses`."""
    clip_loss: Component
    """Energy taken out by the speed limit, J."""
    iterations: Component
    """Most solver iterations of any sub-step."""
    residual: Component
    """Largest scaled solver residual of any sub-step."""
    converged: Component
    finite: Component
    """False once a sub-step has diverged."""
    penetration: Component = 0.0
    """Deepest at the end of any sub-step, m or rad."""
    contact_force: Component = 0.0
    """Of largest magnitude at the end of any sub-step, N or N m."""
    depths: Components = ()
    """Deepest penetration of each contact point at the end of any sub-step, m."""
    efforts: Components = ()
    """Of a servo, in force at the end, N or N m."""
    squares: Components = ()
    """Of a servo, the integral of each squared effort, N² s or N² m² s."""
