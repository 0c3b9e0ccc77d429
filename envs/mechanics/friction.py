"""Dry friction, made smooth around rest."""

from __future__ import annotations

from dataclasses import dataclass

from ..arithmetic.ops import Component, Components, Ops


@dataclass(frozen=True)
class Friction:
    r"""Coulomb friction on every coordinate: :math:`F_i = -c_i \tanh(v_i / v_s)`.

    The sign of the velocity is smoothed over the speed :math:`v_s`, so that the force is analytic;
    a body held by friction creeps at less than that speed instead of sticking.
    Source: Andersson, Söderberg and Björklund (2007), *Friction models for sliding dry, boundary
    and mixed lubricated contacts*, Tribology International 40, equation 3.

    Attributes:
        levels: c of each coordinate, N or N m.
        speed: v_s, m/s or rad/s.
    """

    levels: Components
    speed: Component

    def forces(self, ops: Ops, v: Components) -> Components:
        """Generalized friction force on each coordinate, N or N m."""
        return tuple(
            [-level * ops.tanh(x / self.speed) for level, x in zip(self.levels, v, strict=True)]
        )

    def slopes(self, ops: Ops, v: Components) -> Components:
        """∂F_i/∂v_i of each coordinate."""
        slopes = []
        for level, x in zip(self.levels, v, strict=True):
            tangent = ops.tanh(x / self.speed)
            slopes.append(-level / self.speed * (1.0 - tangent * tangent))
        return tuple(slopes)


def friction_of(levels: Components, speed: Component) -> Friction | None:
    """The friction of these levels, or None where all of them are the number zero."""
    if all(isinstance(level, (int, float)) and level == 0 for level in levels):
        return None
    return Friction(levels, speed)
