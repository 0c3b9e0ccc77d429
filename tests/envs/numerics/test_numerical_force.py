"""What a discretization adds to a motion, against the orders of the methods."""

from __future__ import annotations

import math

import numpy as np
import pytest

from integ_gym.envs import INTEGRATORS, environment_setup, numerics

STATES = np.array([[angle, speed] for angle in (0.5, 2.0, 3.0) for speed in (-4.0, 1.0, 5.0)])
CONTROLS = np.linspace(-0.7, 0.7, len(STATES))


def setup(integrator, dt, max_torque=0.7):
    return environment_setup(
        "IntegPendulum-v0",
        {"integrator": integrator, "dt": dt, "control_period": 0.05, "max_torque": max_torque},
    )


TRUTH = setup("reference", 0.05)


@pytest.mark.parametrize("integrator", [n for n in INTEGRATORS.names() if n != "reference"])
def test_it_falls_with_the_step_as_the_order_says(integrator):
    order = numerics.declared(integrator).order
    coarse, fine = (
        numerics.disturbance(TRUTH, setup(integrator, dt), STATES, CONTROLS).force
        for dt in (0.025, 0.0125)
    )
    assert math.log2(coarse / fine) == pytest.approx(order, abs=0.15)


def test_the_truth_disturbs_nothing():
    found = numerics.disturbance(TRUTH, TRUTH, STATES, CONTROLS)
    assert (found.force, found.power, found.coherence) == (0.0, 0.0, 1.0)


def test_explicit_euler_pumps_and_implicit_euler_drains():
    pumped, drained = (
        numerics.disturbance(TRUTH, setup(name, 0.0125), STATES, CONTROLS).power
        for name in ("explicit_euler", "implicit_euler")
    )
    assert pumped > 0.01
    assert drained == pytest.approx(-pumped, rel=0.1)


def test_what_symplectic_euler_gives_it_takes_back():
    """Over a whole swing; explicit Euler gives all the way, implicit Euler takes."""
    angles = np.linspace(0.0, 2.0 * math.pi, 64, endpoint=False)
    swing = np.stack([math.pi + 0.3 * np.cos(angles), 0.3 * math.sqrt(15.0) * np.sin(angles)], 1)
    coherence = {
        name: numerics.disturbance(TRUTH, setup(name, 0.0125), swing, np.zeros(64)).coherence
        for name in ("explicit_euler", "implicit_euler", "symplectic_euler")
    }
    assert coherence["symplectic_euler"] < 0.05
    assert min(coherence["explicit_euler"], coherence["implicit_euler"]) > 0.999


def test_a_stronger_motor_is_disturbed_less():
    """With no control at all, both numbers are inverse to the limit."""
    states = STATES[STATES[:, 1] > 0.0]
    weak, strong = (
        numerics.disturbance(
            setup("reference", 0.05, limit), setup("explicit_euler", 0.05, limit),
            states, np.zeros(len(states)),
        )
        for limit in (0.1, 0.2)
    )  # fmt: skip
    assert weak.force == pytest.approx(2.0 * strong.force, rel=2e-3)
    assert weak.power == pytest.approx(2.0 * strong.power, rel=1e-12)
