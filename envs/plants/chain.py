"""A hanging chain of equal rods, of any number of links."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, cached_property, reduce
from itertools import accumulate, pairwise
from operator import add
from typing import ClassVar

from integ_gym.support.errors import InputError
from integ_gym.support.parameters import nonnegative, parameter, positive

from ..mechanics import Link, Mechanism
from ..ops.ops import Component, Components, Ops

Matrix = tuple[Components, ...]


@dataclass(frozen=True)
class Chain:
    r"""Equal uniform rods in a vertical plane, each hinged to the end of the one before.

    Every angle :math:`\theta_i` is relative to the link before, the first to hanging; the
    equations are in the angles from hanging, :math:`\phi_i = \theta_1 + \dots + \theta_i`. With
    :math:`c_{ij} = m l^2 (n - \max(i, j) + \tfrac12)`,
    :math:`c_{ii} = m l^2 (n - i + \tfrac13)`, and :math:`P_i` the torque at joint i less that of
    its damper (:math:`P_{n+1} = 0`),

    .. math::
        \sum_j c_{ij}\cos(\phi_i - \phi_j)\,\ddot\phi_j = P_i - P_{i+1}
        - m g l (n - i + \tfrac12)\sin\phi_i - \sum_j c_{ij}\sin(\phi_i - \phi_j)\,\dot\phi_j^2

    Control: a torque at the first joint. This class has three links; :func:`chain_of` gives others.
    The mass matrix depends on all angles but the first, so without gravity the first momentum, the
    angular momentum about the first joint, is conserved.
    Source: Lagrange's equations; Featherstone (2008), *Rigid Body Dynamics Algorithms*, chapter 3.
    """

    mass: float = parameter(1.0, "kg", "mass of each rod", positive)
    length: float = parameter(1.0, "m", "length of each rod", positive)
    gravity: float = parameter(9.81, "m/s^2", "gravitational acceleration", nonnegative)
    damping: float = parameter(0.0, "N m s/rad", "viscous damping at each joint", nonnegative)

    name: ClassVar[str] = "chain"
    coordinates: ClassVar[tuple[str, ...]] = ("theta_1", "theta_2", "theta_3")
    velocities: ClassVar[tuple[str, ...]] = ("theta_1_dot", "theta_2_dot", "theta_3_dot")
    coordinate_units: ClassVar[tuple[str, ...]] = ("rad", "rad", "rad")
    controls: ClassVar[tuple[tuple[str, str], ...]] = (("torque", "N m"),)
    actuated: ClassVar[tuple[int, ...]] = (0,)
    frame: ClassVar[str] = (
        "first joint; theta_1 = 0 hanging, the others = 0 straight, all positive counter-clockwise"
    )
    constant_mass_matrix: ClassVar[bool] = False

    @cached_property
    def mechanism(self) -> Mechanism:
        """The rods, which hang at zero: their own z axes point upwards there."""
        middle, about = 0.5 * self.length, self.mass * self.length * self.length / 12.0
        links = [
            Link(name, "hinge", self.mass, -middle, about, self.damping, length=-self.length)
            for name in self.coordinates
        ]
        return Mechanism(tuple(links), self.gravity)

    @cached_property
    def inertia(self) -> Component:
        """m l², kg m^2."""
        return self.mass * self.length * self.length

    @cached_property
    def weight(self) -> Component:
        """m g l, N m."""
        return self.mass * self.gravity * self.length

    @cached_property
    def _below(self) -> tuple[float, ...]:
        """Of each rod, how many hang below its middle: those after it and its own half."""
        return tuple(len(self.coordinates) - i - 0.5 for i in range(len(self.coordinates)))

    def acceleration(self, ops: Ops, q: Components, v: Components, force: Components) -> Components:
        """θ̈ of each joint, rad/s^2."""
        angles, rates = tuple(accumulate(q)), tuple(accumulate(v))
        sines, cosines = _sines(ops, angles)
        joints = [f - self.damping * x for f, x in zip(force, v, strict=True)]
        torques = _differences(joints[::-1])[::-1]
        pushed = []
        for i, (sine, cosine) in enumerate(zip(sines, cosines, strict=True)):
            total = torques[i] - self.weight * self._below[i] * sine
            for j, rate in enumerate(rates):
                if i != j:
                    bent = sine * cosines[j] - cosine * sines[j]
                    total = total - self.inertia * self._below[max(i, j)] * bent * rate * rate
            pushed.append(total)
        return _differences(_solve(self._absolute(sines, cosines), pushed))

    def energy(self, ops: Ops, q: Components, v: Components) -> Component:
        """Kinetic plus potential energy, J; zero at rest hanging."""
        angles, rates = tuple(accumulate(q)), tuple(accumulate(v))
        sines, cosines = _sines(ops, angles)
        energy = 0.0 * q[0]
        for i, row in enumerate(self._absolute(sines, cosines)):
            energy = energy + self.weight * self._below[i] * (1.0 - cosines[i])
            for entry, rate in zip(row, rates, strict=True):
                energy = energy + 0.5 * entry * rates[i] * rate
        return energy

    def dissipation(self, ops: Ops, q: Components, v: Components) -> Component:
        """Power taken out by all dampers, W, never negative."""
        return self.damping * reduce(add, [x * x for x in v])

    def mass_matrix(self, ops: Ops, q: Components) -> Matrix:
        """n×n mass matrix of the joints' angles, kg m^2."""
        rows = self._absolute(*_sines(ops, tuple(accumulate(q))))
        columns = zip(*map(_sums_to_the_end, rows), strict=True)
        return tuple(map(_sums_to_the_end, columns))  # symmetric

    def _absolute(self, sines: Components, cosines: Components) -> Matrix:
        """Mass matrix of the angles from hanging, kg m^2."""
        return tuple(
            tuple(
                self.inertia * (self._below[i] - 0.5 + 1.0 / 3.0) + 0.0 * cosines[i]
                if i == j
                else self.inertia
                * self._below[max(i, j)]
                * (cosines[i] * cosines[j] + sines[i] * sines[j])
                for j in range(len(sines))
            )
            for i in range(len(sines))
        )


@cache
def chain_of(links: int) -> type[Chain]:
    """The plant of so many links; of three :class:`Chain` itself.

    Raises:
        ValueError: if there is none.
    """
    if links < 1:
        raise InputError(f"`links` must be at least 1, got {links}")
    if links == len(Chain.coordinates):
        return Chain
    names = tuple(f"theta_{i + 1}" for i in range(links))
    own = {
        "__doc__": Chain.__doc__,
        "__module__": Chain.__module__,
        "name": f"chain_{links}",
        "coordinates": names,
        "velocities": tuple(f"{name}_dot" for name in names),
        "coordinate_units": ("rad",) * links,
    }
    return type(f"Chain{links}", (Chain,), own)


def _sines(ops: Ops, angles: Components) -> tuple[Components, Components]:
    """Sines and cosines."""
    return tuple([ops.sin(x) for x in angles]), tuple([ops.cos(x) for x in angles])


def _differences(values: Sequence[Component]) -> Components:
    """Each less the one before; the first as it is."""
    return (values[0], *[b - a for a, b in pairwise(values)])


def _sums_to_the_end(values: Components) -> Components:
    """Of each and all after it."""
    return tuple(accumulate(values[::-1]))[::-1]


def _solve(matrix: Matrix, right: Sequence[Component]) -> Components:
    """x of Ax = b, A symmetric and positive definite, by elimination without pivots."""
    n, rows, found = len(right), [list(row) for row in matrix], list(right)
    for k in range(n):
        inverse = 1.0 / rows[k][k]
        for i in range(k + 1, n):
            share = rows[k][i] * inverse
            found[i] = found[i] - share * found[k]
            for j in range(i, n):
                rows[i][j] = rows[i][j] - share * rows[k][j]
    for k in reversed(range(n)):
        for j in range(k + 1, n):
            found[k] = found[k] - rows[k][j] * found[j]
        found[k] = found[k] / rows[k][k]
    return tuple(found)
