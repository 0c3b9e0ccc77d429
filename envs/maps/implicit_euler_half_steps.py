"""Two half steps of implicit Euler."""

from __future__ import annotations

from typing import ClassVar

from ..arithmetic.ops import Component, Components, Ops
from ..integrators.implicit_euler import ImplicitEuler
from ..integrators.interface import (
    State,
    Step,
    System,
    along,
)


class ImplicitEulerHalfSteps:
    """Implicit Euler at half the step, twice.

    Order 1, L-stable; not symplectic, not reversible. What integrators do that estimate their error
    by step doubling and go on from the finer result. Iterations are those of both half steps.
    Source: Hairer, Nørsett and Wanner, *Solving Ordinary Differential Equations I*, 2nd ed., II.4,
    on step doubling.
    """

    order: ClassVar[int] = 1
    symplectic: ClassVar[bool] = False
    reversible: ClassVar[bool] = False
    solver_tolerance: ClassVar[float] = ImplicitEuler.solver_tolerance
    solver_cap: ClassVar[int] = 2 * ImplicitEuler.solver_cap

    def step(
        self,
        ops: Ops,
        system: System,
        q: Components,
        v: Components,
        losses: Components,
        control: Component,
        dt: Component,
    ) -> Step:
        half, method = 0.5 * dt, ImplicitEuler()
        first = method.step(ops, system, q, v, losses, control, half)
        second = method.step(ops, system, first.q, first.v, first.losses, control, half)
        return second._replace(
            iterations=first.iterations + second.iterations,
            residual=ops.maximum(first.residual, second.residual),
            converged=first.converged & second.converged,
        )

    def losses_between(
        self,
        ops: Ops,
        system: System,
        start: State,
        end: State,
        losses: Components,
        control: Component,
        dt: Component,
    ) -> Components:
        """``losses`` after a step of this map of which both ends are known.

        Its middle is a half step of explicit Euler back from the end.
        """
        half, (end_q, end_v) = 0.5 * dt, end
        slopes, powers = system.rates(ops, end_q, end_v, control)
        middle_q, middle_v = along(end_q, -half, end_v), along(end_v, -half, slopes)
        _, middle_powers = system.rates(ops, middle_q, middle_v, control)
        return along(along(losses, half, middle_powers), half, powers)
