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


@pytest.mark.parametrize(
    ("integrator", "end_percent", "largest_percent", "largest_angle"),
    [
        ("explicit_euler", "3.585e4", "3.670e4", "8.17"),
        ("symplectic_euler", "-0.797", "8.337", "0.0522"),
        ("stormer_verlet", "-0.597", "0.601", "0.0149"),
        ("rk4", "-0.0741", "0.0741", "6.4e-5"),
        ("implicit_midpoint", "4.9e-5", "0.0124", "0.0283"),
        ("implicit_euler", "-100.0", "100.0", "0.445"),
        ("reference", "0.0", "0.0", "0.0"),
    ],
)
def test_worked_example(integrator, end_percent, largest_percent, largest_angle):
    """Energy over 200 s from 0.5 rad at dt 0.05; error of the angle over the first 10 s."""
    energy = energies(integrator, POINT, (pi - 0.5, 0.0), 0.05, 4000)
    drift = 100.0 * (energy / energy[0] - 1.0)
    assert drift[-1] == stated(end_percent)
    assert np.abs(drift).max() == stated(largest_percent)
    if integrator == "reference":
        assert np.abs(drift).max() < 1e-9
        return
    state, largest = np.array([pi + 0.5, 0.0]), 0.0
    for step in range(1, 201):
        state = advance(integrator, POINT, state, 0.05)
        exact, _ = elliptic_pendulum(0.5, sqrt(9.81), 0.05 * step)
        largest = max(largest, abs(state[0] - exact))
    assert largest == stated(largest_angle)


def _released_sideways(integrator, dt, duration):
    energy = energies(integrator, ROD, (pi / 2, 0.0), dt, round(duration / dt))
    return energy / energy[0]


@pytest.mark.parametrize(
    ("dt", "pumped", "over_the_top", "drained"),
    [(0.05, "4.85", "1.75", "9.3e-4"), (0.01, "2.00", "9.95", "0.30")],
)
def test_one_euler_pumps_and_the_other_drains(dt, pumped, over_the_top, drained):
    """Without torque one soon has the energy that reaches the top, twice that of the start."""
    energy = _released_sideways("explicit_euler", dt, 10.0)
    assert energy[-1] == stated(pumped)
    assert np.flatnonzero(energy > 2.0)[0] * dt == stated(over_the_top)
    assert _released_sideways("implicit_euler", dt, 10.0)[-1] == stated(drained)


@pytest.mark.parametrize(
    ("integrator", "bounds"),
    [
        ("symplectic_euler", ("0.091", "0.035")),
        ("stormer_verlet", ("7.8e-3", "1.25e-3")),
        ("implicit_midpoint", ("1.6e-3", "2.5e-4")),
        ("rk4", ("8.3e-4", "8.65e-6")),
    ],
)
def test_the_error_of_the_energy_over_100_seconds(integrator, bounds):
    """Of symplectic methods no more than after 10 s; rk4 drifts slowly."""
    for dt, bound in zip((0.05, 0.02), bounds, strict=True):
        change = np.abs(_released_sideways(integrator, dt, 100.0) - 1.0)
        assert change.max() == stated(bound)
        early = change[: round(10.0 / dt)].max()
        assert bool(early == pytest.approx(change.max(), rel=1e-3)) is (integrator != "rk4")


def test_symplectic_euler_drains_a_cart_pole():
    energy = energies("symplectic_euler", CartPole(), (0.0, 0.0, pi - 0.5, 0.0), 0.02, 50_000)
    for seconds, percent in ((10, "-3.435"), (100, "-13.34"), (1000, "-56.03")):
        assert 100.0 * (energy[50 * seconds] / energy[0] - 1.0) == stated(percent)
