"""Energy drift of the native integrators against independently measured numbers."""

from __future__ import annotations

from math import pi

import numpy as np
import pytest
from motions import energies
from scipy.integrate import solve_ivp

from integ_gym.envs.engines.native import NativeEngine
from integ_gym.envs.ops import SCALAR
from integ_gym.envs.plants.cart_pole import CartPole
from integ_gym.envs.plants.pendulum import Pendulum
from integ_gym.envs.system import PlantSystem

POINT = Pendulum(gravity=9.81, mass_distribution="point")
ROD = Pendulum(gravity=10.0)


@pytest.fixture(scope="module")
def worked_example():
    """Energies over 200 s from 0.5 rad, dt 0.05, per integrator."""
    names = (
        "explicit_euler", "symplectic_euler", "stormer_verlet", "rk4", "implicit_midpoint",
        "implicit_euler",
    )  # fmt: skip
    return {n: energies(POINT, n, 0.05, 4000, (pi - 0.5,), (0.0,)) for n in names}


@pytest.mark.parametrize(
    ("integrator", "end_percent", "largest_percent", "tolerance"),
    [
        ("explicit_euler", 35850.0, 36700.0, 2e-3),
        ("symplectic_euler", -0.797, 8.337, 1e-3),
        ("stormer_verlet", -0.597, 0.601, 1e-3),
        ("rk4", -0.0741, 0.0741, 1e-3),
        ("implicit_midpoint", 4.9e-5, 0.0124, 1e-2),
        ("implicit_euler", -100.0, 100.0, 1e-3),
    ],
)
def test_worked_example(worked_example, integrator, end_percent, largest_percent, tolerance):
    energy = worked_example[integrator]
    drift = 100.0 * (energy / energy[0] - 1.0)
    assert drift[-1] == pytest.approx(end_percent, rel=tolerance)
    assert np.abs(drift).max() == pytest.approx(largest_percent, rel=tolerance)


@pytest.mark.parametrize(
    ("integrator", "largest_error"),
    [
        ("explicit_euler", 8.17),
        ("symplectic_euler", 0.0522),
        ("rk4", 6.4e-5),
        ("implicit_midpoint", 0.0283),
        ("implicit_euler", 0.445),
    ],
)
def test_worked_example_angle_error(integrator, largest_error):
    times = np.arange(201) * 0.05
    truth = solve_ivp(
        lambda t, y: (y[1], 9.81 * np.sin(y[0])), (0, 10), (pi - 0.5, 0.0), "DOP853",
        t_eval=times, rtol=1e-12, atol=1e-12,
    ).y[0]  # fmt: skip
    engine = NativeEngine(PlantSystem(POINT), integrator, 0.05)
    q, v, angles = (pi - 0.5,), (0.0,), [pi - 0.5]
    for _ in range(200):
        motion = engine.advance(SCALAR, q, v, ((0.0, 1),), None)
        q, v = motion.q, motion.v
        angles.append(q[0])
    assert np.abs(angles - truth).max() == pytest.approx(largest_error, rel=1e-2)


def _released_sideways(integrator: str, dt: float, duration: float) -> np.ndarray:
    energy = energies(ROD, integrator, dt, round(duration / dt), (pi / 2,), (0.0,))
    return energy / energy[0]


@pytest.mark.parametrize(
    ("dt", "ratio", "over_the_top"), [(0.05, 4.85, 1.75), (0.02, 2.63, 5.28), (0.01, 2.00, 9.95)]
)
def test_explicit_euler_pumps(dt, ratio, over_the_top):
    energy = _released_sideways("explicit_euler", dt, 10.0)
    assert energy[-1] == pytest.approx(ratio, rel=3e-3)
    barrier = 2.0
    first_above = np.flatnonzero(energy > barrier)[0]
    assert first_above * dt == pytest.approx(over_the_top, abs=0.6 * dt)


@pytest.mark.parametrize(("dt", "ratio"), [(0.05, 9e-4), (0.02, 0.072), (0.01, 0.30)])
def test_implicit_euler_drains(dt, ratio):
    assert _released_sideways("implicit_euler", dt, 10.0)[-1] == pytest.approx(ratio, rel=0.06)


@pytest.mark.parametrize(
    ("integrator", "bounds"),
    [
        ("symplectic_euler", (0.091, 0.035, 0.017)),
        ("stormer_verlet", (7.8e-3, 1.3e-3, 3.1e-4)),
        ("implicit_midpoint", (1.6e-3, 2.5e-4, 6e-5)),
    ],
)
def test_symplectic_methods_bound_the_error(integrator, bounds):
    for dt, bound in zip((0.05, 0.02, 0.01), bounds, strict=True):
        change = np.abs(_released_sideways(integrator, dt, 100.0) - 1.0)
        assert change.max() == pytest.approx(bound, rel=0.05)
        assert change[: round(10.0 / dt)].max() == pytest.approx(change.max(), rel=0.05)


def test_rk4_drifts_slowly():
    for dt, drift in ((0.05, 8.3e-4), (0.02, 8.7e-6), (0.01, 2.8e-7)):
        change = np.abs(_released_sideways("rk4", dt, 100.0) - 1.0)
        assert change.max() == pytest.approx(drift, rel=0.05)


@pytest.mark.parametrize(("seconds", "percent"), [(10, -3.435), (100, -13.34), (1000, -56.03)])
def test_symplectic_euler_drains_a_cart_pole(seconds, percent):
    steps = round(seconds / 0.02)
    energy = energies(
        CartPole(), "symplectic_euler", 0.02, steps, (0.0, pi - 0.5), (0.0, 0.0)
    )  # fmt: skip
    assert 100.0 * (energy[-1] / energy[0] - 1.0) == pytest.approx(percent, rel=1e-3)
