"""What is conserved, and what the integrators do to what should be."""

import math

import numpy as np
import pytest
from checks import ALL, APPROXIMATE
from own_plants import CentralSpring
from stated import by_hand

from integ_gym.envs.numerics.energy import energies, energy_growth
from integ_gym.envs.numerics.identity import declared
from integ_gym.envs.numerics.stepping import advance
from integ_gym.envs.plants.cart_pole import CartPole
from integ_gym.envs.plants.oscillator import Oscillator

CART_POLE = CartPole()
HANGING = (0.0, 0.0, math.pi - 0.5, 0.0)
"""Cart at rest, pole released 0.5 rad from hanging."""


def _momentum(state) -> float:
    """Horizontal momentum of cart and pole, kg m/s."""
    swing = CART_POLE.mass_moment * math.cos(state[2]) * state[3]
    return CART_POLE.total_mass * state[1] + swing


def _momentum_change(integrator: str, dt: float) -> float:
    state = np.array([0.0, 0.4, math.pi - 1.5, 0.0])
    start, largest = _momentum(state), 0.0
    for _ in range(round(2.0 / dt)):
        state = advance(integrator, CART_POLE, state, dt)
        largest = max(largest, abs(_momentum(state) - start))
    return largest


def test_momentum_without_force_is_conserved_by_the_reference():
    assert _momentum_change("reference", 0.05) < 1e-12


@pytest.mark.parametrize("integrator", APPROXIMATE)
def test_momentum_without_force_changes_at_the_order(integrator):
    coarse, fine = (_momentum_change(integrator, dt) for dt in (0.02, 0.01))
    assert math.log2(coarse / fine) > declared(integrator).order - 0.1


@pytest.mark.parametrize("integrator", ALL)
def test_angular_momentum_is_conserved_by_symplectic_methods(integrator):
    """A bilinear invariant of a central force, exact where the mass matrix is constant."""
    state = np.array([0.8, 0.1, -0.3, 1.2])
    start = state[0] * state[3] - state[2] * state[1]
    end = advance(integrator, CentralSpring(), state, 0.02, 200)
    change = abs(end[0] * end[3] - end[2] * end[1] - start)
    if declared(integrator).symplectic or integrator == "reference":
        assert change < 1e-11
    else:
        assert change > 1e-9


GROWTH = {
    "explicit_euler": ("exponential", 1),
    "implicit_euler": ("exponential", -1),
    "symplectic_euler": ("bounded", 0),
    "stormer_verlet": ("bounded", 0),
    "implicit_midpoint": ("bounded", 0),
    "rk4": ("linear", -1),
    "reference": ("bounded", 0),
}
"""Kind and sign of the energy's drift on the harmonic oscillator, h ω = 0.1, 500 steps."""


@pytest.mark.parametrize("integrator", ALL)
def test_energy_growth_on_the_oscillator(integrator):
    place = "GROWTH of tests/envs/integrators/test_conservation.py"
    kind, sign = by_hand(GROWTH, integrator, place)
    found = energy_growth(energies(integrator, Oscillator(), (1.0, 0.0), 0.1, 500))
    assert found.kind == kind
    if sign:
        assert math.copysign(1, found.drift) == sign
    expected = {"explicit_euler": 1.01**500 - 1, "implicit_euler": 1 - 1.01**-500}
    if integrator in expected:
        assert found.largest == pytest.approx(expected[integrator], rel=1e-10)


@pytest.mark.parametrize("integrator", ["stormer_verlet", "implicit_midpoint"])
def test_reversible_methods_bound_the_energy_of_the_cart_pole(integrator):
    assert energy_growth(energies(integrator, CART_POLE, HANGING, 0.02, 5000)).kind == "bounded"
