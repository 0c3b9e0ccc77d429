"""Plants of a user's own, with two degrees of freedom."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class CentralSpring:
    """A mass on a stiffening spring in a horizontal plane, (x, y) from the spring's anchor.

    V = k r²/2 + c r⁴/4; angular momentum is conserved. No Jacobian is given, so that implicit
    integrators take finite differences.
    """

    mass: float = 1.3
    stiffness: float = 4.0
    hardening: float = 2.0
    damping: float = 0.0

    name = "central_spring"
    coordinates = ("x", "y")
    velocities = ("x_dot", "y_dot")
    coordinate_units = ("m", "m")
    controls = (("force", "N"),)
    frame = "anchor of the spring"
    actuated = (0,)
    constant_mass_matrix = True

    def acceleration(self, ops, q, v, force):
        pull = self.stiffness + self.hardening * (q[0] * q[0] + q[1] * q[1])
        return tuple(
            (f - self.damping * w - pull * x) / self.mass
            for x, w, f in zip(q, v, force, strict=True)
        )

    def energy(self, ops, q, v):
        square = q[0] * q[0] + q[1] * q[1]
        kinetic = 0.5 * self.mass * (v[0] * v[0] + v[1] * v[1])
        return kinetic + 0.5 * self.stiffness * square + 0.25 * self.hardening * square * square

    def dissipation(self, ops, q, v):
        return self.damping * (v[0] * v[0] + v[1] * v[1])

    def mass_matrix(self, ops, q):
        return (self.mass, 0.0), (0.0, self.mass)


@dataclass(frozen=True)
class PolarElasticPendulum:
    """A bob on a radial spring in polar coordinates (r, φ from hanging): M = diag(m, m r²)."""

    mass: float = 1.0
    stiffness: float = 100.0
    length: float = 1.0
    gravity: float = 10.0

    name = "polar_elastic_pendulum"
    coordinates = ("r", "phi")
    velocities = ("r_dot", "phi_dot")
    coordinate_units = ("m", "rad")
    controls = (("force", "N"),)
    frame = "pivot; phi = 0 hanging"
    actuated = (0,)
    constant_mass_matrix = False

    def acceleration(self, ops, q, v, force):
        (r, phi), (r_dot, phi_dot) = q, v
        radial = r * phi_dot * phi_dot + self.gravity * ops.cos(phi)
        radial = radial - self.stiffness / self.mass * (r - self.length) + force[0] / self.mass
        turning = -self.gravity * ops.sin(phi) - 2.0 * r_dot * phi_dot
        return radial, turning / r + force[1] / (self.mass * r * r)

    def energy(self, ops, q, v):
        stretch = q[0] - self.length
        kinetic = 0.5 * self.mass * (v[0] * v[0] + q[0] * q[0] * v[1] * v[1])
        height = self.mass * self.gravity * q[0] * ops.cos(q[1])
        return kinetic + 0.5 * self.stiffness * stretch * stretch - height

    def dissipation(self, ops, q, v):
        return 0.0 * v[0]

    def mass_matrix(self, ops, q):
        return (self.mass, 0.0), (0.0, self.mass * q[0] * q[0])
