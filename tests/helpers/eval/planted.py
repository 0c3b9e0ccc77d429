"""Integrators that claim to be what they are not, and plants that contradict themselves."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import mutants
import numpy as np

from integ_gym.envs.integrators.euler import ExplicitEuler
from integ_gym.envs.integrators.implicit import ImplicitMidpoint
from integ_gym.envs.integrators.interface import Step
from integ_gym.envs.integrators.rk4 import RK4
from integ_gym.envs.plants.pendulum import Pendulum
from integ_gym.support.parameters import nonnegative, parameter, positive


class Boaster(ExplicitEuler):
    """Explicit Euler that claims order 2, symplecticity and reversibility."""

    order = 2
    symplectic = True
    reversible = True


class Silent:
    """Explicit Euler that says nothing of itself."""

    step = ExplicitEuler.step


class Nowhere:
    """Arrives at no number at all."""

    order = 1

    def step(self, ops, system, q, v, losses, control, dt):
        nothing = tuple(x * float("nan") for x in q)
        return Step(nothing, nothing, losses)


class Raising:
    """Cannot take a step."""

    def step(self, ops, system, q, v, losses, control, dt):
        raise KeyError("no such\nthing")


class Wordy(RK4):
    """Says its order in words."""

    order = "two"


class Unsure(RK4):
    """Says of its reversibility what is no answer."""

    reversible = "mostly"


class Pair(RK4):
    """Returns a pair in the place of a step."""

    def step(self, *arguments):
        return tuple(super().step(*arguments)[:2])


class Late(RK4):
    """Fails in its second step."""

    def step(self, ops, system, q, v, losses, control, dt):
        if not np.all(np.equal(v[0], 0.0)):
            raise RuntimeError("too fast")
        return super().step(ops, system, q, v, losses, control, dt)


class Forgetful(RK4):
    """RK4 that books no losses."""

    def step(self, ops, system, q, v, losses, control, dt):
        return super().step(ops, system, q, v, losses, control, dt)._replace(losses=losses)


class Unsolved(ImplicitMidpoint):
    """Reports honestly that its equation is not solved."""

    def step(self, *arguments):
        return super().step(*arguments)._replace(residual=1e-3, converged=False)


class Growing(ExplicitEuler):
    """Explicit Euler that claims to conserve a canonical form, and nothing else."""

    symplectic = True


class Heun(RK4):
    """Heun's method, which says what it is."""

    order = 2

    def step(self, ops, system, q, v, losses, control, dt):
        a1, p1 = system.rates(ops, q, v, control)
        end_q = tuple(x + dt * y for x, y in zip(q, v, strict=True))
        end_v = tuple(x + dt * y for x, y in zip(v, a1, strict=True))
        a2, p2 = system.rates(ops, end_q, end_v, control)
        half = 0.5 * dt
        return Step(
            tuple(x + half * (y + z) for x, y, z in zip(q, v, end_v, strict=True)),
            tuple(x + half * (y + z) for x, y, z in zip(v, a1, a2, strict=True)),
            tuple(x + half * (y + z) for x, y, z in zip(losses, p1, p2, strict=True)),
        )


WrongWeight, *_ = mutants.wrong_helper(RK4, "step", "_weight_stages")


class NoPlant:
    """Has an acceleration and nothing else."""

    def acceleration(self, ops, q, v, force):
        return (0.0 * q[0],)


@dataclass(frozen=True)
class Unbooked(Pendulum):
    """A pendulum whose damping acts and is not booked."""

    def dissipation(self, ops, q, v):
        return 0.0 * v[0]


@dataclass(frozen=True)
class Lifted(Pendulum):
    """A pendulum whose energy at rest is not zero."""

    def energy(self, ops, q, v):
        return super().energy(ops, q, v) + 1.0


@dataclass(frozen=True)
class Heavy(Pendulum):
    """A pendulum whose mass matrix is twice what its accelerations say."""

    def mass_matrix(self, ops, q):
        return ((2.0 * self.inertia,),)


@dataclass(frozen=True)
class Wavering(Pendulum):
    """A pendulum that denies that its mass matrix is constant."""

    constant_mass_matrix: ClassVar[bool] = False


@dataclass(frozen=True)
class Blunt(Pendulum):
    """A pendulum with the sign of its Jacobian wrong."""

    def jacobian(self, ops, q, v, force):
        ((by_q,),), by_v = super().jacobian(ops, q, v, force)
        return ((-by_q,),), by_v


@dataclass(frozen=True)
class Slider:
    """A block on a hardening spring, damped as it stands: m a = F - b v - k x - c x^3."""

    mass: float = parameter(1.0, "kg", "mass of the block", positive)
    stiffness: float = parameter(20.0, "N/m", "of the spring at rest", positive)
    hardening: float = parameter(5.0, "N/m^3", "cubic stiffness", nonnegative)
    damping: float = parameter(0.4, "N s/m", "viscous damping", nonnegative)

    name: ClassVar[str] = "slider"
    coordinates: ClassVar[tuple[str, ...]] = ("x",)
    velocities: ClassVar[tuple[str, ...]] = ("x_dot",)
    coordinate_units: ClassVar[tuple[str, ...]] = ("m",)
    controls: ClassVar[tuple[tuple[str, str], ...]] = (("force", "N"),)
    frame: ClassVar[str] = "x = 0 where the spring is at rest"
    actuated: ClassVar[tuple[int, ...]] = (0,)
    constant_mass_matrix: ClassVar[bool] = True

    def acceleration(self, ops, q, v, force):
        spring = self.stiffness * q[0] + self.hardening * q[0] ** 3
        return ((force[0] - self.damping * v[0] - spring) / self.mass,)

    def energy(self, ops, q, v):
        spring = 0.5 * self.stiffness * q[0] ** 2 + 0.25 * self.hardening * q[0] ** 4
        return 0.5 * self.mass * v[0] ** 2 + spring

    def dissipation(self, ops, q, v):
        return self.damping * v[0] ** 2

    def mass_matrix(self, ops, q):
        return ((self.mass,),)


@dataclass(frozen=True)
class Falling(Slider):
    """A block that nothing holds."""

    def acceleration(self, ops, q, v, force):
        return (9.81 + 0.0 * q[0],)


@dataclass(frozen=True)
class Hill(Slider):
    """A block that its spring pushes away."""

    def acceleration(self, ops, q, v, force):
        return (self.stiffness / self.mass * q[0],)
