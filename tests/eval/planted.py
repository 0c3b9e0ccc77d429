"""Integrators that claim to be what they are not, for the diagnosis to find out."""

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
