"""The native engine: integ-gym's own integrators, for scalars, arrays and JAX."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from integ_gym.support.errors import InputTypeError

from ..integrators.interface import Step
from ..mechanics import PlantSystem
from ..ops.ops import Component, Components, Ops
from ..registries import INTEGRATORS, TRUTH
from .stepping import SteppedEngine


class NativeEngine(SteppedEngine):
    """Applies one of the integrators to the plant's equations of motion.

    Args:
        system: plant with its stops, friction and speed limit.
        integrator: a registered name or ``"module:Class"``.
        dt: integration step, s.

    Raises:
        ValueError: for an unknown integrator.
    """

    name: ClassVar[str] = "native"
    package: ClassVar[str] = "integ-gym"
    maps: ClassVar[Mapping[str, str]] = {n: n for n in INTEGRATORS.parts if n != TRUTH}
    batched: ClassVar[bool] = True
    reports: bool = True

    def __init__(self, system: PlantSystem, integrator: str, dt: Component) -> None:
        super().__init__(system, dt)
        self.integrator = INTEGRATORS.load(integrator)()
        self.solver_tolerance = getattr(self.integrator, "solver_tolerance", None)
        self.solver_cap = getattr(self.integrator, "solver_cap", None)

    def move(
        self, ops: Ops, q: Components, v: Components, losses: Components, control: Component
    ) -> Step:
        """One step of the integrator."""
        step: Step = self.integrator.step(ops, self.system, q, v, losses, control, self.dt)
        if not isinstance(step, tuple) or len(step) != len(Step._fields):
            raise InputTypeError(
                f"{type(self.integrator).__name__}.step must return an integ_gym.Step, got "
                f"{step!r:.60}; docs/how-to/adding.md has an example"
            )
        return step
