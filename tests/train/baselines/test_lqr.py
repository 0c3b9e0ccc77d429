"""Linear-quadratic design against results known by hand."""

from __future__ import annotations

import math

import gymnasium as gym
import numpy as np
import pytest
from playing import CART_POLE, PENDULUM, TIGHT, setup_of

from integ_gym.train.controllers import discretize_zoh, linearize, lqr_gain

pytest.importorskip("scipy")


def test_linearization_of_the_pendulum() -> None:
    plant = setup_of(PENDULUM, mass=2.0, length=0.5, damping=0.3).plant
    a, b = linearize(plant)
    np.testing.assert_allclose(
        a, [[0.0, 1.0], [1.5 * 10.0 / 0.5, -0.3 / plant.inertia]], rtol=1e-8, atol=1e-9
    )
    np.testing.assert_allclose(b, [[0.0], [1.0 / plant.inertia]], rtol=1e-8, atol=1e-9)


def test_linearization_of_the_cart_pole() -> None:
    """Against M q̈ = G q + F solved by hand: M = [[m+M, ml], [ml, I]], G = diag(0, mgl)."""
    plant = setup_of(CART_POLE).plant
    mass_matrix = np.array([[1.1, 0.05], [0.05, 4.0 / 3.0 * 0.1 * 0.25]])
    stiffness = np.linalg.solve(mass_matrix, np.diag([0.0, 0.1 * 9.8 * 0.5]))
    push = np.linalg.solve(mass_matrix, [1.0, 0.0])
    a, b = linearize(plant)
    np.testing.assert_allclose(a[[1, 3]][:, [0, 2]], stiffness, rtol=1e-8, atol=1e-8)
    np.testing.assert_allclose(a[[0, 2]], [[0, 1, 0, 0], [0, 0, 0, 1]], atol=1e-12)
    np.testing.assert_allclose(b.ravel(), [0.0, push[0], 0.0, push[1]], rtol=1e-8, atol=1e-9)


def test_held_is_the_environment_s_own_map_near_upright() -> None:
    env = gym.make(PENDULUM, **TIGHT, damping=0.2)
    a, b = discretize_zoh(*linearize(env.unwrapped.setup.plant), 0.05)  # type: ignore[attr-defined]
    state, torque = np.array([1e-4, -2e-4]), 1e-4
    env.reset(options={"state": state})
    env.step(np.array([torque]))
    expected = a @ state + b[:, 0] * torque
    np.testing.assert_allclose(env.unwrapped.state, expected, rtol=1e-6)  # type: ignore[attr-defined]


def test_lqr_gain_of_a_scalar_system() -> None:
    """x ← x + u with Q = R = 1: P is the golden ratio, K = P / (1 + P)."""
    golden = (1.0 + math.sqrt(5.0)) / 2.0
    one = np.eye(1)
    np.testing.assert_allclose(lqr_gain(one, one, one, one), [[golden / (1.0 + golden)]])


def test_a_system_that_cannot_be_held_is_refused() -> None:
    with pytest.raises(ValueError, match="no linear control holds this plant upright"):
        lqr_gain(2.0 * np.eye(1), np.zeros((1, 1)), np.eye(1), np.eye(1))
