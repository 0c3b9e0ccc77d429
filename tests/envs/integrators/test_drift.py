"""Energy drift of the native integrators against independently measured numbers.

Numbers are texts: a measurement must round to every digit written.
"""

from __future__ import annotations

from math import pi, sqrt

import numpy as np
import pytest
from checks import POINT, ROD, elliptic_pendulum
from stated import stated

from integ_gym.envs.numerics.energy import energies
from integ_gym.envs.numerics.stepping import advance
from integ_gym.envs.plants.cart_pole import CartPole

STEPS = (0.05, 0.02, 0.01)


@pytest.mark.parametrize(
    ("integrator", "end_percent", "largest_percent"),
    [
        ("explicit_euler", "3.585e4", "3.670e4"),
        ("symplectic_euler", "-0.797", "8.337"),
        ("stormer_verlet", "-0.597", "0.601"),
        ("rk4", "-0.0741", "0.0741"),
        ("implicit_midpoint", "4.9e-5", "0.0124"),
        ("implicit_euler", "-100.0", "100.0"),
    ],
)
def test_worked_example(integrator, end_percent, largest_percent):
    """200 s from 0.5 rad, dt 0.05."""
    energy = energies(integrator, POINT, (pi - 0.5, 0.0), 0.05, 4000)
    drift = 100.0 * (energy / energy[0] - 1.0)
    assert drift[-1] == stated(end_percent)
    assert np.abs(drift).max() == stated(largest_percent)


def test_the_reference_has_no_drift():
    energy = energies("reference", POINT, (pi - 0.5, 0.0), 0.05, 4000)
    assert np.abs(energy / energy[0] - 1.0).max() < 1e-11


@pytest.mark.parametrize(
    ("integrator", "largest_error"),
    [
        ("explicit_euler", "8.17"),
        ("symplectic_euler", "0.0522"),
        ("stormer_verlet", "0.0149"),
        ("rk4", "6.4e-5"),
        ("implicit_midpoint", "0.0283"),
        ("implicit_euler", "0.445"),
    ],
)
def test_worked_example_angle_error(integrator, largest_error):
    state, largest = np.array([pi + 0.5, 0.0]), 0.0
    for step in range(1, 201):
        state = advance(integrator, POINT, state, 0.05)
        exact, _ = elliptic_pendulum(0.5, sqrt(9.81), 0.05 * step)
        largest = max(largest, abs(state[0] - exact))
    assert largest == stated(largest_error)


def _released_sideways(integrator: str, dt: float, duration: float) -> np.ndarray:
    energy = energies(integrator, ROD, (pi / 2, 0.0), dt, round(duration / dt))
    return energy / energy[0]


@pytest.mark.parametrize(
    ("dt", "ratio", "over_the_top"),
    [(0.05, "4.85", "1.75"), (0.02, "2.63", "5.28"), (0.01, "2.00", "9.95")],
)
def test_explicit_euler_pumps(dt, ratio, over_the_top):
    """Without torque it soon has the energy that reaches the top, twice that of the start."""
    energy = _released_sideways("explicit_euler", dt, 10.0)
    assert energy[-1] == stated(ratio)
    assert np.flatnonzero(energy > 2.0)[0] * dt == stated(over_the_top)


@pytest.mark.parametrize(("dt", "ratio"), [(0.05, "9.3e-4"), (0.02, "0.072"), (0.01, "0.30")])
def test_implicit_euler_drains(dt, ratio):
    assert _released_sideways("implicit_euler", dt, 10.0)[-1] == stated(ratio)


@pytest.mark.parametrize(
    ("integrator", "bounds"),
    [
        ("symplectic_euler", ("0.091", "0.035", "0.017")),
        ("stormer_verlet", ("7.8e-3", "1.25e-3", "3.1e-4")),
        ("implicit_midpoint", ("1.6e-3", "2.5e-4", "6.2e-5")),
    ],
)
def test_symplectic_methods_bound_the_error(integrator, bounds):
    """The same after 10 s as after 100 s."""
    for dt, bound in zip(STEPS, bounds, strict=True):
        change = np.abs(_released_sideways(integrator, dt, 100.0) - 1.0)
        assert change.max() == stated(bound)
        assert change[: round(10.0 / dt)].max() == pytest.approx(change.max(), rel=1e-3)


def test_rk4_drifts_slowly():
    for dt, drift in zip(STEPS, ("8.3e-4", "8.65e-6", "2.75e-7"), strict=True):
        change = np.abs(_released_sideways("rk4", dt, 100.0) - 1.0)
        assert change.max() == stated(drift)


@pytest.mark.parametrize(
    ("seconds", "percent"), [(10, "-3.435"), (100, "-13.34"), (1000, "-56.03")]
)
def test_symplectic_euler_drains_a_cart_pole(seconds, percent):
    start, steps = (0.0, 0.0, pi - 0.5, 0.0), round(seconds / 0.02)
    energy = energies("symplectic_euler", CartPole(), start, 0.02, steps)
    assert 100.0 * (energy[-1] / energy[0] - 1.0) == stated(percent)
