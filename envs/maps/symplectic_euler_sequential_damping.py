"""Symplectic Euler with a drift in ten parts and joints damped one after another before each."""

from __future__ import annotations

from typing import ClassVar

from ..arithmetic.ops import Component, Components, Ops
from ..integrators.interface import Step, along
from ..mechanics.system import PlantSystem
from ._families.linearly_implicit import damping_slopes


class SymplecticEulerSequentialDamping:
    r"""Kick without damping, then ten times: damp each joint implicitly, and drift a tenth.

    .. math:: w = v_0 + h \left(a(q_0, v_0) + M^{-1} D v_0\right)

    and in each part of length :math:`p = h/10`, for the joints j in turn,

    .. math:: w \leftarrow w - M^{-1} e_j \frac{p\,d_j w_j}{1 + p\,d_j\,(M^{-1})_{jj}}

    and then :math:`q \leftarrow q + p\,w`, with M of :math:`q_0` throughout. Order 1. Without
    damping it is symplectic Euler. Energy lost to damping: in each part, the damping force of its
    end times its displacement.
    Source: the temporal Gauss-Seidel solver of NVIDIA's PhysX 5, articulation joint drives; found
    by measurement. Its parts: Macklin et al. (2019), *Small steps in physics simulation*.
    """

    order: ClassVar[int] = 1
    parts: ClassVar[int] = 10

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
        slopes = damping_slopes(ops, system, q, v)
        kicked = along(v, dt, acceleration)
        w = tuple(
            x - dt * sum(slope * y for slope, y in zip(row, v, strict=True))
            for x, row in zip(kicked, slopes, strict=True)
        )
        part = dt / self.parts
        columns = tuple(zip(*slopes, strict=True))
        for _ in range(self.parts):
            for j, column in enumerate(columns):
                w = along(w, part * w[j] / (1.0 - part * column[j]), column)
            q = along(q, part, w)
            _, loss_rates = system.rates(ops, q, w, control)
            losses = along(losses, part, loss_rates)
        return Step(q, w, losses)
