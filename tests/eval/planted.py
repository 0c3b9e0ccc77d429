"""Integrators that claim to be what they are not, and a plant that is none."""

from __future__ import annotations

from integ_gym.envs.integrators.explicit_euler import ExplicitEuler


class Boaster(ExplicitEuler):
    """Explicit Euler that claims order 2, symplecticity and reversibility."""

    order = 2
    symplectic = True
    reversible = True


class Silent:
    """Explicit Euler that says nothing of itself."""

    step = ExplicitEuler.step


class NoPlant:
    """Has an acceleration and nothing else."""

    def acceleration(self, ops, q, v, force):
        return (0.0 * q[0],)
