"""Engines that move rigid bodies: told the plant's mechanism, and checked against the plant."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from functools import cache
from math import nan
from typing import ClassVar

from ...arithmetic.ops import Component, Components, Ops
from ...integrators.interface import State, Step, along
from ...maps.lookup import one_step_map
from ...mechanics.system import PlantSystem
from ...plants.interface import Plant
from .._stepping.foreign import ForeignEngine, Run
from .agreement import TOLERANCE, Array, check_agreement, mechanism_of


class RigidBodyEngine(ForeignEngine):
    """Builds the plant's mechanism in a simulator and advances it under generalized forces.

    Friction and stops are forces of our own, taken at the start of each step and held during it:
    a simulator takes generalized forces once in a step. Under a map that evaluates forces once
    that is the map's own law; any other is of first order where they act.

    Raises:
        ValueError: for a plant without a mechanism or whose damping is not its mechanism's, for
            one too light for the engine, and for an engine whose mass matrix or gravity force is
            not the plant's.
    """

    holds_resistance: ClassVar[bool] = True
    own_stops: ClassVar[bool] = True
    least_inertia: ClassVar[float] = 0.0
    """Moment of inertia of a body below which it takes none, kg m^2."""
    tells_speeds: ClassVar[bool] = False
    """Whether it has a :meth:`run_with_speeds`."""

    def __init__(self, system: PlantSystem, integrator: str, dt: float) -> None:
        super().__init__(system, integrator, dt)
        self.free = mechanism_of(self.name, system.plant)
        self.mechanism = self.free.stopped(system.engine_stops)
        self._map = one_step_map(self.map)
        self._map_losses_of = getattr(self._map, "losses_of", None)
        self._map_losses_between = getattr(self._map, "losses_between", None)
        self._run_with_speeds = cache(self.run_with_speeds)
        self._damped = any(link.damping for link in self.mechanism.links)
        self.build()
        self._check()

    @abstractmethod
    def build(self) -> None:
        """Make the simulator's model of :attr:`mechanism`, whose own stops :attr:`free` lacks."""

    @abstractmethod
    def at_rest(self, q: Components) -> tuple[Array, Array]:
        """The simulator's mass matrix, (dof, dof), and its generalized force of gravity, (dof,)."""

    def _check(self) -> None:
        """Compare the model with the plant.

        Raises:
            ValueError: if they differ, and if the least moment of inertia that the engine takes
                makes a difference.
        """
        least = self.least_inertia
        for link in self.mechanism.links:
            about_joint = link.inertia + link.mass * link.centre**2
            tolerated = TOLERANCE[self.width] * about_joint
            if link.joint == "hinge" and max(link.inertia, tolerated) < least:
                raise ValueError(
                    f"engine {self.name!r} takes no body's moment of inertia below {least:g} "
                    f"kg m^2, which the plant's {about_joint:g} kg m^2 about {link.coordinate!r} "
                    "is too small for; use a larger mass or length, or an engine without this "
                    "limit, such as 'native', 'drake' or 'pinocchio'"
                )
        check_agreement(self, self.system.plant)

    @property
    def straight(self) -> bool:
        """Whether nothing is booked between steps but work, and damping that is told with them."""
        system = self.system
        if system.steep or system.max_speed is not None or system.engine_stops is not None:
            return False
        return not self._damped or (self.tells_speeds and self._map_losses_of is not None)

    def run_with_speeds(self, count: int) -> Run:
        """As :meth:`run`, with each velocity's mean square over the ends of steps after (q, v)."""
        raise NotImplementedError

    def stride(
        self,
        ops: Ops,
        q: Components,
        v: Components,
        losses: Components,
        force: Components,
        count: int,
    ) -> Step:
        """Take ``count`` steps; lost is what joint damping takes."""
        if not self._damped:
            return super().stride(ops, q, v, losses, force, count)
        if count == 1:
            end_q, end_v, *report = self.travel(ops, q, v, force, 1)
            speeds = v if self._map_losses_of == "start" else end_v
        else:
            end_q, end_v, squares, *report = self._travel_with_speeds(ops, q, v, force, count)
            if self._map_losses_of == "start":
                pairs = zip(squares, v, end_v, strict=True)
                squares = tuple([x + (a * a - b * b) / count for x, a, b in pairs])
            speeds = tuple([ops.sqrt(ops.maximum(0.0, x)) for x in squares])
        # Dampers at the joints: the mean power is that at the root mean square of each velocity.
        power = self.system.plant.dissipation(ops, end_q, speeds)
        lost = along(losses, count * self.dt, (power,))
        return Step(end_q, end_v, self._of_whole_steps(ops, lost, report[-1]), *report)

    def _travel_with_speeds(
        self, ops: Ops, q: Components, v: Components, force: Components, count: int
    ) -> tuple[Components, Components, Components, Component, Component, Component]:
        """As :meth:`travel`, with the mean squares of the velocities after q and v."""
        n, run = len(q), self._run_with_speeds(count)
        flat, report = self._called_with(ops, run, (*q, *v, *force), 3 * n)
        return flat[:n], flat[n : 2 * n], flat[2 * n :], *report

    def move(
        self, ops: Ops, q: Components, v: Components, losses: Components, control: Component
    ) -> Step:
        """One of the simulator's steps, with friction, contact and losses."""
        resisting, rates = self.system.resistance(ops, q, v)
        drive = self.system.generalized(control)
        force = tuple([a + b for a, b in zip(drive, resisting, strict=True)])
        end_q, end_v, iterations, residual, converged = self.travel(ops, q, v, force, 1)
        losses = along(losses, self.dt, rates)
        if self._damped:
            losses = (self._damping(ops, (q, v), (end_q, end_v), force, losses[0]), *losses[1:])
            losses = self._of_whole_steps(ops, losses, converged)
        if self.system.engine_stops is None:
            return Step(end_q, end_v, losses, iterations, residual, converged)
        push = self._push(ops, q, v, end_v, force)
        losses = (losses[0], ops.where(push == 0.0, losses[1], nan))
        return Step(end_q, end_v, losses, iterations, residual, converged, push)

    def _damping(
        self, ops: Ops, start: State, end: State, force: Components, loss: Component
    ) -> Component:
        """``loss`` with what joint damping takes in a step: as the map books it."""
        plant = self.system.plant
        if self._map_losses_of is not None:
            state = start if self._map_losses_of == "start" else end
            return along((loss,), self.dt, (plant.dissipation(ops, *state),))[0]
        held = HeldForce(plant, force)
        if self._map_losses_between is not None:
            return self._map_losses_between(ops, held, start, end, (loss,), 0.0, self.dt)[0]
        return self._map.step(ops, held, *start, (loss,), 0.0, self.dt).losses[0]

    def _of_whole_steps(self, ops: Ops, losses: Components, converged: Component) -> Components:
        """``losses``; that of damping is not known where the engine divided a step of its map."""
        if not self.reports or self.system.engine_stops is not None:
            return losses
        return (ops.where(converged, losses[0], nan), *losses[1:])

    def _push(
        self, ops: Ops, q: Components, v: Components, end: Components, force: Components
    ) -> Component:
        """Force of the engine's own stop: what it changed in the momentum, over the step; or 0.

        What energy it took is not told, so that the ledger is open where it acts.
        """
        held = HeldForce(self.system.plant, force)
        free = self._map.step(ops, held, q, v, (0.0,), 0.0, self.dt).v
        changes = [a - b for a, b in zip(end, free, strict=True)]
        assert self.system.engine_stops is not None
        row = self.system.plant.mass_matrix(ops, q)[self.system.engine_stops.coordinate]
        impulse = sum(a * b for a, b in zip(row, changes, strict=True))
        felt = abs(impulse) > TOLERANCE[self.width] * 10.0 * (1.0 + abs(free[0]))
        return ops.where(felt, impulse / self.dt, 0.0)


@dataclass(frozen=True)
class HeldForce:
    """A plant under a generalized force that is held: what an engine integrates in one step."""

    plant: Plant
    force: Components
    steep: ClassVar[bool] = False
    kinked: ClassVar[bool] = False

    def rates(
        self, ops: Ops, q: Components, v: Components, control: Component
    ) -> tuple[Components, Components]:
        """Accelerations, and the power of damping, W."""
        losses = (self.plant.dissipation(ops, q, v),)
        return self.plant.acceleration(ops, q, v, self.force), losses

    def slopes(
        self, ops: Ops, q: Components, v: Components, control: Component
    ) -> tuple[tuple[Components, ...], tuple[Components, ...]] | None:
        """(∂a/∂q, ∂a/∂v), or None if the plant gives none."""
        jacobian = getattr(self.plant, "jacobian", None)
        return None if jacobian is None else jacobian(ops, q, v, self.force)

    def limit(self, ops: Ops, v: Components) -> Components:
        """``v``: no limit acts within a step."""
        return v
