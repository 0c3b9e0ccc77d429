"""The undamped harmonic oscillator: the linear test equation. No task is about it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from integ_gym.support.parameters import parameter, positive

from ..mechanics import Slopes
from ..ops.ops import Component, Components, Ops


@dataclass(frozen=True)
class Oscillator:
    r"""A unit mass on a spring.

    .. math:: \ddot x = -\omega^2 x + F

    State (x, ẋ); control: force F. One step of a linear method is a 2×2 matrix in (ωx, ẋ) that
    depends on hω alone.
    Source: Hairer, Lubich and Wanner, *Geometric Numerical Integration*, 2nd ed., I.5.2.
    """

    frequency: float = parameter(1.0, "rad/s", "natural frequency ω", positive)

    name: ClassVar[str] = "oscillator"
    coordinates: ClassVar[tuple[str, ...]] = ("x",)
    velocities: ClassVar[tuple[str, ...]] = ("x_dot",)
    coordinate_units: ClassVar[tuple[str, ...]] = ("m",)
    controls: ClassVar[tuple[tuple[str, str], ...]] = (("force", "N"),)
    frame: ClassVar[str] = "x = 0 where the spring is at rest"
    actuated: ClassVar[tuple[int, ...]] = (0,)
    constant_mass_matrix: ClassVar[bool] = True

    def acceleration(self, ops: Ops, q: Components, v: Components, force: Components) -> Components:
        """Acceleration, m/s^2, as a 1-tuple."""
        return (force[0] - self.frequency * self.frequency * q[0],)

    def jacobian(self, ops: Ops, q: Components, v: Components, force: Components) -> Slopes:
        """(∂a/∂q, ∂a/∂v), each a 1×1 nested tuple."""
        zero = 0.0 * q[0]
        return ((zero - self.frequency * self.frequency,),), ((zero,),)

    def energy(self, ops: Ops, q: Components, v: Components) -> Component:
        """Kinetic plus potential energy, J; zero at rest."""
        stretch = self.frequency * q[0]
        return 0.5 * (v[0] * v[0] + stretch * stretch)

    def dissipation(self, ops: Ops, q: Components, v: Components) -> Component:
        """Nothing, W."""
        return 0.0 * v[0]

    def mass_matrix(self, ops: Ops, q: Components) -> tuple[Components, ...]:
        """1×1 mass matrix, kg."""
        return ((1.0,),)
