"""Velocity kicks that solve one linear system: implicit in the velocity to first order."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar

from ...arithmetic.ops import Component, Components, Ops
from ...integrators._solving.linear import solve_linear
from ...integrators.interface import Step, along
from ...mechanics.system import PlantSystem


class LinearlyImplicit(ABC):
    """Kick implicitly in some of the forces, then drift; losses by the rates of the end.

    The kick is Δv with (I - h ∂a/∂v) Δv = h a.
    """

    order: ClassVar[int] = 1
    losses_of: ClassVar[str] = "end"
    """End of the step whose rates of loss, times the step, are its losses."""

    @abstractmethod
    def slopes(
        self, ops: Ops, system: PlantSystem, q: Components, v: Components, control: Component
    ) -> tuple[Components, ...]:
        """∂a/∂v by the forces that are taken implicitly."""

    def step(
        self,
        ops: Ops,
        system: PlantSystem,
        q: Components,
        v: Components,
        losses: Components,
        control: Component,
        dt: Component,
    ) -> Step:
        acceleration, _ = system.rates(ops, q, v, control)
        matrix = [
            tuple((1.0 if i == j else 0.0) - dt * slope for j, slope in enumerate(row))
            for i, row in enumerate(self.slopes(ops, system, q, v, control))
        ]
        v = along(v, dt, solve_linear(ops, tuple(matrix), acceleration))
        q = along(q, dt, v)
        _, loss_rates = system.rates(ops, q, v, control)
        return Step(q, v, along(losses, dt, loss_rates))


def damping_slopes(
    ops: Ops, system: PlantSystem, q: Components, v: Components
) -> tuple[Components, ...]:
    """∂a/∂v by the plant's viscous damping alone, -M⁻¹D with a diagonal D."""
    plant = system.plant
    none = (0.0,) * len(v)
    free = plant.acceleration(ops, q, none, none)
    columns = []
    for j in range(len(v)):
        unit = (*none[:j], 1.0, *none[j + 1 :])
        drag = (*none[:j], -plant.dissipation(ops, q, unit), *none[j + 1 :])
        slowed = plant.acceleration(ops, q, none, drag)
        columns.append([a - b for a, b in zip(slowed, free, strict=True)])
    return tuple(zip(*columns, strict=True))
