"""The classical fourth-order Runge-Kutta method."""

from __future__ import annotations

from typing import ClassVar

from ..ops.ops import Component, Components, Ops, along
from .interface import LinearTheory, Step, System


class RK4:
    r"""Four explicit stages with weights 1/6, 1/3, 1/3, 1/6.

    Order 4; not symplectic, not reversible: accurate, with a slow drift of energy, downwards on
    an oscillator. Stable there for hω < 2√2.
    Source: Kutta (1901); Hairer, Nørsett and Wanner, *Solving Ordinary Differential Equations I*,
    2nd ed., table II.1.2, left.
    """

    order: ClassVar[int] = 4
    symplectic: ClassVar[bool] = False
    reversible: ClassVar[bool] = False
    theory: ClassVar[LinearTheory] = LinearTheory(
        "−(hω)⁶/72 + (hω)⁸/576",
        2.0 * 2.0**0.5,
        2.785293563405282,  # real root of R(-z) = 1
        lambda z: 1.0 - z**6 / 72.0 + z**8 / 576.0,
    )

    def step(
        self,
        ops: Ops,
        system: System,
        q: Components,
        v: Components,
        losses: Components,
        control: Components,
        dt: Component,
    ) -> Step:
        half = 0.5 * dt
        a1, p1 = system.rates(ops, q, v, control)
        v2 = along(v, half, a1)
        a2, p2 = system.rates(ops, along(q, half, v), v2, control)
        v3 = along(v, half, a2)
        a3, p3 = system.rates(ops, along(q, half, v2), v3, control)
        v4 = along(v, dt, a3)
        a4, p4 = system.rates(ops, along(q, dt, v3), v4, control)
        sixth = dt / 6.0
        return Step(
            along(q, sixth, _weight_stages(v, v2, v3, v4)),
            along(v, sixth, _weight_stages(a1, a2, a3, a4)),
            along(losses, sixth, _weight_stages(p1, p2, p3, p4)),
        )


def _weight_stages(k1: Components, k2: Components, k3: Components, k4: Components) -> Components:
    return tuple([a + 2.0 * (b + c) + d for a, b, c, d in zip(k1, k2, k3, k4, strict=True)])
