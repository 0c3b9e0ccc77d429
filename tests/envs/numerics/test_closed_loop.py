"""The step at which one fixed linear policy goes unstable, by integrator."""

import math

import numpy as np
import pytest

from integ_gym.envs.numerics.stepping import critical_step
from integ_gym.envs.plants.cart_pole import CartPole
from integ_gym.envs.plants.pendulum import Pendulum
from integ_gym.train.controllers import linearize, lqr_gain

COLUMNS = ("explicit_euler", "symplectic_euler", "rk4", "implicit_euler", "reference")


def _gain(plant, dt, state_cost, control_cost):
    """LQR designed on the explicit Euler model of the plant."""
    a, b = linearize(plant)
    cost = np.diag(np.array(state_cost, dtype=float))
    return lqr_gain(np.eye(len(a)) + dt * a, dt * b, cost, np.array([[control_cost]]))


def _next_millisecond(step: float) -> float:
    return math.ceil(1000.0 * step) / 1000.0


@pytest.mark.parametrize(
    ("plant", "dt", "state_cost", "control_cost", "expected"),
    [
        (CartPole(), 0.02, (10, 1, 100, 1), 0.1, (0.269, 0.107, 0.141, 0.097, 0.141)),
        (Pendulum(), 0.05, (10, 1), 0.01, (0.132, 0.099, 0.113, 0.093, 0.113)),
    ],
    ids=["cart_pole", "pendulum"],
)
def test_critical_steps(plant, dt, state_cost, control_cost, expected):
    """The first unstable whole millisecond."""
    gain = _gain(plant, dt, state_cost, control_cost)
    found = dict(zip(COLUMNS, (critical_step(n, plant, gain) for n in COLUMNS), strict=True))
    assert tuple(_next_millisecond(step) for step in found.values()) == expected
    truth = found["reference"]
    assert found["explicit_euler"] > truth > found["symplectic_euler"] > found["implicit_euler"]
    if isinstance(plant, CartPole):
        assert found["explicit_euler"] / truth == pytest.approx(1.9, abs=0.02)


def test_ends_of_the_scan():
    plant = Pendulum()
    assert critical_step("rk4", plant, np.zeros((1, 2)), smallest=1e-3) == 1e-3
    gain = _gain(plant, 0.05, (10, 1), 0.01)
    assert critical_step("rk4", plant, gain, largest=0.05) == math.inf
