"""The elastic pendulum: a bob on a spring."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

from integ_gym.support.parameters import nonnegative, parameter, positive

from ..mechanics import Slopes
from ..ops.ops import Component, Components, Ops


@dataclass(frozen=True)
class ElasticPendulum:
    r"""A point mass on a massless spring in a vertical plane, in Cartesian coordinates.

    .. math::
        m\ddot x &= F - b\dot x - k (r - L)\,x / r \\
        m\ddot y &= -m g - b\dot y - k (r - L)\,(y - L_0) / r, \qquad
        r = \sqrt{x^2 + (y - L_0)^2}

    (x, y) is the bob's displacement from where it hangs at rest, :math:`L_0 = L + m g / k` below
    the pivot, y upwards. State (x, ẋ, y, ẏ); control: horizontal force F on the bob. The mass
    matrix is constant, so symplectic integrators are symplectic here. Small motions are a swing at
    :math:`\sqrt{g / L_0}` and a bounce at :math:`\sqrt{k / m}`; the bounce is the fast one and
    bounds the step of the explicit integrators.
    Source: Breitenberger and Mueller (1981), *The elastic pendulum: a nonlinear paradigm*, Journal
    of Mathematical Physics 22.
    """

    mass: float = parameter(1.0, "kg", "mass of the bob", positive)
    length: float = parameter(1.0, "m", "length of the unloaded spring", positive)
    stiffness: float = parameter(1000.0, "N/m", "stiffness of the spring", positive)
    gravity: float = parameter(9.81, "m/s^2", "gravitational acceleration", nonnegative)
    damping: float = parameter(0.0, "N s/m", "viscous damping of the bob", nonnegative)

    name: ClassVar[str] = "elastic_pendulum"
    coordinates: ClassVar[tuple[str, ...]] = ("x", "y")
    velocities: ClassVar[tuple[str, ...]] = ("x_dot", "y_dot")
    coordinate_units: ClassVar[tuple[str, ...]] = ("m", "m")
    controls: ClassVar[tuple[tuple[str, str], ...]] = (("force", "N"),)
    frame: ClassVar[str] = "place where the bob hangs at rest; x to the right, y upwards"
    actuated: ClassVar[tuple[int, ...]] = (0,)
    constant_mass_matrix: ClassVar[bool] = True

    @cached_property
    def hanging_length(self) -> Component:
        """Distance of the bob at rest from the pivot, m."""
        return self.length + self.mass * self.gravity / self.stiffness

    @cached_property
    def _inverse_mass(self) -> Component:
        return 1.0 / self.mass

    @cached_property
    def _weight(self) -> Component:
        return self.mass * self.gravity

    def acceleration(self, ops: Ops, q: Components, v: Components, force: Components) -> Components:
        """(ẍ, ÿ) in m/s^2."""
        across, up, reach = self._spring(ops, q)
        pull = self.stiffness * (1.0 - self.length / reach)
        return (
            (force[0] - self.damping * v[0] - pull * across) * self._inverse_mass,
            (force[1] - self.damping * v[1] - pull * up - self._weight) * self._inverse_mass,
        )

    def jacobian(self, ops: Ops, q: Components, v: Components, force: Components) -> Slopes:
        """(∂a/∂q, ∂a/∂v), each a 2×2 nested tuple."""
        across, up, reach = self._spring(ops, q)
        rate = self.stiffness * self._inverse_mass
        slack = self.length / reach
        bend = rate * slack / (reach * reach)
        diagonal = rate * (slack - 1.0)
        mixed = -bend * across * up
        by_q = (
            (diagonal - bend * across * across, mixed),
            (mixed, diagonal - bend * up * up),
        )
        drag = 0.0 * across - self.damping * self._inverse_mass
        return by_q, ((drag, 0.0 * across), (0.0 * across, drag))

    def energy(self, ops: Ops, q: Components, v: Components) -> Component:
        """Kinetic plus potential energy, J; zero at rest hanging."""
        _, _, reach = self._spring(ops, q)
        stretch, sag = reach - self.length, self.hanging_length - self.length
        kinetic = 0.5 * self.mass * (v[0] * v[0] + v[1] * v[1])
        elastic = 0.5 * self.stiffness * (stretch * stretch - sag * sag)
        return kinetic + elastic + self._weight * q[1]

    def dissipation(self, ops: Ops, q: Components, v: Components) -> Component:
        """Power taken out by damping, W, never negative."""
        return self.damping * (v[0] * v[0] + v[1] * v[1])

    def mass_matrix(self, ops: Ops, q: Components) -> tuple[Components, ...]:
        """2×2 mass matrix, kg."""
        zero = 0.0 * self.mass
        return (self.mass, zero), (zero, self.mass)

    def _spring(self, ops: Ops, q: Components) -> Components:
        """Bob relative to the pivot (across, up), and its distance from it, m."""
        across, up = q[0], q[1] - self.hanging_length
        return across, up, ops.sqrt(across * across + up * up)
