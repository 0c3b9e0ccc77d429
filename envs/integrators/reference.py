"""The reference solution: the plant solved to rounding over one step."""

from __future__ import annotations

from typing import ClassVar

from ..ops.ops import Component, Components, Ops
from .dop853 import trial_step
from .interface import UNLIMITED, LinearTheory, Step, System
from .newton import time_of_kink

_SMALLEST = 1e-13
"""Inner steps below this share of ``dt`` mean that the motion cannot be followed."""


class Reference:
    """Dormand-Prince 8(5,3) with its own adaptive steps inside ``dt``, per lane.

    Local error per inner step below 3e-13 (1 + |y|) in float64, so that the result does not depend
    on ``dt`` beyond rounding. Where the system has a kink, only an inner step of 1.5e-8 ``dt`` goes
    across it, and those before are aimed at it; a step that may have touched it and turned back is
    taken again in parts. Not symplectic by construction; its energy error is rounding.
    ``iterations`` counts inner steps, accepted or not; a step that needs more than the cap is
    reported as not converged.
    Source: Hairer, Nørsett and Wanner, *Solving Ordinary Differential Equations I*, 2nd ed., II.5
    and II.10.
    """

    order: ClassVar[int] = 8
    symplectic: ClassVar[bool] = False
    reversible: ClassVar[bool] = False
    theory: ClassVar[LinearTheory] = LinearTheory("the exact motion", UNLIMITED, UNLIMITED)
    solver_tolerance: ClassVar[float] = 3e-13
    solver_cap: ClassVar[int] = 5000

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
        n = len(q)
        start = (*q, *v, *losses)
        size = len(start)
        tolerance = max(self.solver_tolerance, 16.0 * ops.epsilon)
        shortest = ops.epsilon**0.5 * dt

        def derivative(y: Components) -> Components:
            acceleration, loss_rates = system.rates(ops, y[:n], y[n:], control)
            return (*y[n:], *acceleration, *loss_rates)

        def unfinished(carry: tuple[Component, ...]) -> Component:
            remaining, trial, attempts = carry[size : size + 3]
            return (remaining > 0.0) & (trial > _SMALLEST * dt) & (attempts < self.solver_cap)

        def attempt(carry: tuple[Component, ...]) -> tuple[Component, ...]:
            y, remaining, trial, attempts, worst = carry[:size], *carry[size:]
            h = ops.minimum(trial, remaining)
            end, error = trial_step(ops, derivative, y, 2 * n, h, tolerance)
            accepted = error <= 1.0
            following = h * _growth(ops, error)
            if system.kinked:
                look = time_of_kink(ops, system, n, y, end, h)
                early = (look >= 0.0) & (h > shortest)
                accepted = accepted & ops.where(early, False, True)
                nearer = ops.maximum(look - 0.5 * shortest, shortest)
                following = ops.where(early, nearer, following)
            y = tuple([ops.where(accepted, b, a) for a, b in zip(y, end, strict=True)])
            remaining = ops.where(accepted, remaining - h, remaining)
            worst = ops.where(accepted, ops.maximum(worst, error * tolerance), worst)
            return (*y, remaining, following, attempts + 1, worst)

        end = ops.while_loop(unfinished, attempt, (*start, dt, dt, 0, 0.0 * dt))
        return Step(
            end[:n], end[n : 2 * n], end[2 * n : size], end[size + 2], end[size + 3],
            end[size] <= 0.0,
        )  # fmt: skip


def _growth(ops: Ops, error: Component) -> Component:
    """Step-size factor of HNW II.4.13, with a non-finite error treated as a large one."""
    usable = ops.where(ops.isfinite(error), ops.maximum(error, 1e-10), 1e10)
    return ops.minimum(5.0, ops.maximum(0.2, 0.9 * usable ** (-1.0 / 8.0)))
