"""Engines as their users get them: with what the suite's own engines switch off, and as maps."""

from __future__ import annotations

from typing import ClassVar
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray

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


def swing_up(observations: NDArray[np.float32]) -> NDArray[np.float32]:
    """Forces in N that swing the cart-pole up in every engine as its users get it.

    More energy than standing upright has is pumped into the pole, for friction takes some of it;
    near the top a linear regulator takes over. Its numbers were chosen on the starts of seed 900.

    Args:
        observations: of `IntegCartPoleSwingUp-v0`, shape (n, 5).

    Returns:
        Shape (n, 1).
    """
    x, x_dot, cosine, sine, rate = observations.astype(np.float64).T
    angle, energy = np.arctan2(sine, cosine), rate**2 / 60.0 + 0.49 * cosine
    pumped = np.clip(29.4 * (0.75 - energy), -11.0, 11.0) * -np.copysign(1.0, rate * cosine)
    pumped -= 1.96 * x + 2.8 * x_dot
    held = 6.1 * x + 8.3 * x_dot + 66.0 * angle + 17.0 * rate
    near = (abs(angle) < 0.6) & (abs(rate + 3.8 * angle) < 2.0)
    force = np.clip(np.where(near, held, 1.1 * pumped), -10.0, 10.0)
    return force.astype(np.float32)[:, None]
