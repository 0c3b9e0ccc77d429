"""Engines as their users get them: with what the suite's own engines switch off, and as maps."""

from __future__ import annotations

from typing import ClassVar
from unittest.mock import patch

from integ_gym.envs.engines import sapien
from integ_gym.envs.engines.pybullet import PybulletEngine
from integ_gym.envs.integrators.interface import Step
from integ_gym.envs.ops.ops import Component, Components, Ops, along
from integ_gym.envs.plants.cart_pole import CartPole
from integ_gym.envs.plants.system import PlantSystem

DAMPING = 0.04
"""Bullet's linear and angular damping of every link, 1/s; and of its square, by speed."""

FASTEST = 100.0
"""Joint speed at which Bullet clips, m/s or rad/s."""


class Pybullet(PybulletEngine):
    """PyBullet with its own link damping and speed limit."""

    def build(self) -> None:
        super().build()
        for link in range(-1, len(self.mechanism.links)):
            self._bullet.changeDynamics(
                self._body, link, linearDamping=DAMPING, angularDamping=DAMPING,
                maxJointVelocity=FASTEST, physicsClientId=self._client,
            )  # fmt: skip


class Sapien(sapien.SapienEngine):
    """SAPIEN with PhysX's own link damping, joint friction, speed limits and sleep."""

    def build(self) -> None:
        with patch.object(sapien, "_release", lambda articulation: None):
            super().build()

    def _check(self) -> None:
        """Nothing: with friction the impulses that measure the mass matrix give another."""


class BulletEuler:
    """What :class:`Pybullet` does to a cart-pole: symplectic Euler under damping of every link.

    A body of mass m and moment of inertia I with velocity u and rate w is slowed by the force
    ``m u (d + d |u|)`` and the torque ``I w (d + d |w|)`` with d of :data:`DAMPING`; found by
    measurement. The speed limit is left out: a cart-pole of these tasks never meets it.
    """

    order: ClassVar[int] = 1
    symplectic: ClassVar[bool] = False
    reversible: ClassVar[bool] = False

    def step(
        self,
        ops: Ops,
        system: PlantSystem,
        q: Components,
        v: Components,
        losses: Components,
        control: Components,
        dt: Component,
    ) -> Step:
        plant = system.plant
        assert isinstance(plant, CartPole)
        drive = system.with_resistance(ops, q, v, system.to_generalized_force(control))
        drag = _drag(ops, plant, q, v)
        force = tuple([a - b for a, b in zip(drive, drag, strict=True)])
        v = along(v, dt, plant.acceleration(ops, q, v, force))
        return Step(along(q, dt, v), v, losses)


def _drag(ops: Ops, plant: CartPole, q: Components, v: Components) -> Components:
    """Generalized force by which Bullet's damping slows a cart-pole, without its sign."""
    across, up = plant.length * ops.cos(q[1]), -plant.length * ops.sin(q[1])
    along_x, along_z = v[0] + across * v[1], up * v[1]
    speed = ops.sqrt(along_x * along_x + along_z * along_z)
    pole = plant.mass * DAMPING * (1.0 + speed)
    own = plant.inertia - plant.mass * plant.length * plant.length
    turning = own * v[1] * DAMPING * (1.0 + abs(v[1]))
    cart = plant.cart_mass * v[0] * DAMPING * (1.0 + abs(v[0]))
    moment = pole * (across * along_x + up * along_z)
    return cart + pole * along_x, moment + turning
