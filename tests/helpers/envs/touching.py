"""Plants that touch the ground, and an environment of each: a puck, and a rod on both its ends."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import inf
from typing import ClassVar

import gymnasium as gym

from integ_gym import (
    ContactFrame,
    ContactPoint,
    IntegEnv,
    IntegVectorEnv,
    nonnegative,
    parameter,
    positive,
)
from integ_gym.envs.tasks.interface import saturate


@dataclass(frozen=True)
class Puck:
    """A point mass above an inclined plane: x down along it, z away from it; a force along x."""

    mass: float = parameter(1.0, "kg", "mass", positive)
    gravity: float = parameter(9.81, "m/s^2", "towards the plane", nonnegative)
    pull: float = parameter(0.0, "m/s^2", "gravity along the plane", nonnegative)
    damping: float = parameter(0.0, "N s/m", "viscous damping", nonnegative)
    stiffness: float = parameter(1e4, "N/m", "of the plane", positive)
    plane_damping: float = parameter(0.5, "s/m", "of the plane", nonnegative)
    friction: float = parameter(0.5, "1", "coefficient of friction", nonnegative)
    friction_speed: float = parameter(0.01, "m/s", "over which friction changes sign", positive)

    name: ClassVar[str] = "puck"
    coordinates: ClassVar[tuple[str, ...]] = ("x", "z")
    velocities: ClassVar[tuple[str, ...]] = ("x_dot", "z_dot")
    coordinate_units: ClassVar[tuple[str, ...]] = ("m", "m")
    controls: ClassVar[tuple[tuple[str, str], ...]] = (("force", "N"),)
    frame: ClassVar[str] = "the plane; z away from it"
    actuated: ClassVar[tuple[int, ...]] = (0,)
    contact_names: ClassVar[tuple[str, ...]] = ("puck",)
    constant_mass_matrix: ClassVar[bool] = True

    @cached_property
    def contacts(self):
        return (_point(self, self._frame),)

    def _frame(self, ops, q):
        return ContactFrame(q[1], (0.0, 1.0), (1.0, 0.0))

    def acceleration(self, ops, q, v, force):
        return (
            (force[0] - self.damping * v[0]) / self.mass + self.pull,
            (force[1] - self.damping * v[1]) / self.mass - self.gravity,
        )

    def jacobian(self, ops, q, v, force):
        zero = 0.0 * q[0]
        drag = zero - self.damping / self.mass
        return ((zero, zero), (zero, zero)), ((drag, zero), (zero, drag))

    def energy(self, ops, q, v):
        kinetic = 0.5 * (v[0] * v[0] + v[1] * v[1])
        return self.mass * (kinetic + self.gravity * q[1] - self.pull * q[0])

    def dissipation(self, ops, q, v):
        return self.damping * (v[0] * v[0] + v[1] * v[1])

    def mass_matrix(self, ops, q):
        zero = 0.0 * self.mass
        return (self.mass, zero), (zero, self.mass)


@dataclass(frozen=True)
class Rod:
    """A uniform rod in a vertical plane: its middle at (x, z), turned by theta from lying."""

    mass: float = parameter(2.0, "kg", "mass", positive)
    length: float = parameter(0.6, "m", "length", positive)
    gravity: float = parameter(9.81, "m/s^2", "gravitational acceleration", nonnegative)
    stiffness: float = parameter(4e3, "N/m", "of the ground", positive)
    plane_damping: float = parameter(0.5, "s/m", "of the ground", nonnegative)
    friction: float = parameter(0.6, "1", "coefficient of friction", nonnegative)
    friction_speed: float = parameter(0.05, "m/s", "over which friction changes sign", positive)

    name: ClassVar[str] = "rod"
    coordinates: ClassVar[tuple[str, ...]] = ("x", "z", "theta")
    velocities: ClassVar[tuple[str, ...]] = ("x_dot", "z_dot", "theta_dot")
    coordinate_units: ClassVar[tuple[str, ...]] = ("m", "m", "rad")
    controls: ClassVar[tuple[tuple[str, str], ...]] = (("torque", "N m"),)
    frame: ClassVar[str] = "the ground; z upwards"
    actuated: ClassVar[tuple[int, ...]] = (2,)
    contact_names: ClassVar[tuple[str, ...]] = ("left", "right")
    constant_mass_matrix: ClassVar[bool] = True

    @cached_property
    def inertia(self):
        return self.mass * self.length * self.length / 12.0

    @cached_property
    def contacts(self):
        return _point(self, self._left), _point(self, self._right)

    def _left(self, ops, q):
        return self._end(ops, q, -0.5)

    def _right(self, ops, q):
        return self._end(ops, q, 0.5)

    def _end(self, ops, q, share):
        across, up = (share * self.length * f(q[2]) for f in (ops.cos, ops.sin))
        return ContactFrame(q[1] + up, (0.0, 1.0, across), (1.0, 0.0, 0.0 - up))

    def acceleration(self, ops, q, v, force):
        return (
            force[0] / self.mass + 0.0 * v[0],
            force[1] / self.mass - self.gravity,
            force[2] / self.inertia + 0.0 * v[2],
        )

    def jacobian(self, ops, q, v, force):
        zero = 0.0 * q[0]
        return ((zero,) * 3,) * 3, ((zero,) * 3,) * 3

    def energy(self, ops, q, v):
        kinetic = 0.5 * self.mass * (v[0] * v[0] + v[1] * v[1]) + 0.5 * self.inertia * v[2] * v[2]
        return kinetic + self.mass * self.gravity * q[1]

    def dissipation(self, ops, q, v):
        return 0.0 * v[0]

    def mass_matrix(self, ops, q):
        zero = 0.0 * self.mass
        return (self.mass, zero, zero), (zero, self.mass, zero), (zero, zero, self.inertia)


@dataclass(frozen=True)
class RodWithoutJacobian(Rod):
    """Implicit integrators take finite differences."""

    jacobian = None


def _point(plant, frame):
    return ContactPoint(
        frame, plant.stiffness, plant.plane_damping, plant.friction, plant.friction_speed
    )


@dataclass(frozen=True)
class SlidePuck:
    """Bring the puck to rest where x is 0."""

    max_force: float = parameter(10.0, "N", "limit of the force", positive)

    plant: ClassVar[str] = "touching:Puck"
    starts: ClassVar[tuple[str, ...]] = ("falling",)
    start_options: ClassVar[tuple[str, ...]] = ()
    discrete: ClassVar[int | None] = None
    goal: ClassVar[str] = "|x| < 0.05 m throughout the last 1 s"
    goal_stay: ClassVar[float] = 1.0
    observation_names: ClassVar[tuple[str, ...]] = ("x", "z")
    observation_units: ClassVar[tuple[str, ...]] = ("m", "m")

    @property
    def control_limits(self):
        return ((-self.max_force, self.max_force),)

    def observation_limits(self, max_speed):
        return inf, inf

    def command(self, ops, action):
        return saturate(ops, action, self.control_limits)

    def observe(self, ops, q, v):
        return q[0], q[1]

    def reward(self, ops, q, v, mean_squares, terminated, control_period):
        return (1.0 - q[0] * q[0]) * control_period

    def worst_return(self, ops, remaining, control_period, top_speed):
        return -1e6 * control_period * remaining

    def terminated(self, ops, q, v):
        return abs(q[0]) > 1e3

    def at_goal(self, ops, q, v):
        return abs(q[0]) < 0.05

    def draw_start(self, rng, start, options):
        return rng.uniform(-1.0, 1.0), rng.uniform(-2.0, 2.0), rng.uniform(0.0, 0.05), 0.0


@dataclass(frozen=True)
class TurnRod(SlidePuck):
    """The same of the rod's middle."""

    plant: ClassVar[str] = "touching:Rod"

    def draw_start(self, rng, start, options):
        height = rng.uniform(0.05, 0.1), rng.uniform(-1.0, 0.0)
        return rng.uniform(-1.0, 1.0), rng.uniform(-2.0, 2.0), *height, rng.uniform(-0.4, 0.4), 0.0


class PuckEnv(IntegEnv, gym.Env):
    """The puck on its plane."""

    task_name = "touching:SlidePuck"
    defaults: ClassVar = {"integrator": "rk4", "dt": 0.002, "control_period": 0.02}


class PuckVectorEnv(IntegVectorEnv, gym.vector.VectorEnv):
    """The same, vectorized."""

    env_class = PuckEnv


class RodEnv(IntegEnv, gym.Env):
    """The rod on the ground."""

    task_name = "touching:TurnRod"
    defaults: ClassVar = PuckEnv.defaults


class RodVectorEnv(IntegVectorEnv, gym.vector.VectorEnv):
    """The same, vectorized."""

    env_class = RodEnv


ENVIRONMENTS = ("TouchingPuck-v0", "TouchingRod-v0")
for env_id, stem in zip(ENVIRONMENTS, ("Puck", "Rod"), strict=True):
    gym.register(
        env_id, f"touching:{stem}Env", vector_entry_point=f"touching:{stem}VectorEnv"
    )  # fmt: skip
