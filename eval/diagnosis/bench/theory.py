"""What theory says of integrators on linear problems."""

from __future__ import annotations

from integ_gym.envs import INTEGRATORS, LinearTheory


def theory_of(integrator: str) -> LinearTheory | None:
    """What an integrator's class itself declares; None where it says nothing.

    None, too, of a user's own that cannot be loaded, where only its results are drawn.
    """
    try:
        owner = INTEGRATORS.load(integrator)
    except ValueError:
        return None
    theory: LinearTheory | None = vars(owner).get("theory")
    return theory
