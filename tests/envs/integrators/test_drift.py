"""Energy drift of the native integrators against independently measured numbers.

Numbers are texts: a measurement must round to every digit written.
"""

from math import pi

import numpy as np
import pytest
from checks import ROD
from stated import stated

from integ_gym.envs.numerics.energy import energies
from integ_gym.envs.plants.cart_pole import CartPole


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
