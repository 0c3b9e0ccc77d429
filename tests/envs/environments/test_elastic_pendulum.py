"""The elastic pendulum: physics, and what a stiff spring does to the integrators."""

from __future__ import annotations

from math import cos, pi, sin, sqrt

import gymnasium as gym
import numpy as np
import pytest
from checks import POINT

from integ_gym.envs.engines.stepping import NativeEngine, PlantSystem
from integ_gym.envs.ops.ops import SCALAR
from integ_gym.envs.plants.elastic_pendulum import ElasticPendulum

STIFF = ElasticPendulum(stiffness=1000.0)
BOUNCE = sqrt(STIFF.stiffness / STIFF.mass)
LIMITS = {"symplectic_euler": 2.0, "stormer_verlet": 2.0, "rk4": 2.0 * sqrt(2.0)}
"""Largest stable product of step and frequency."""


def _bounce(integrator: str, product: float, steps: int = 400):
    """Motion after a small vertical bounce in steps of ``product`` over the bounce's frequency."""
    engine = NativeEngine(PlantSystem(STIFF), integrator, product / BOUNCE)
    return engine.advance(SCALAR, (0.0, 1e-3), (0.0, 0.0), ((0.0, steps),), None)


@pytest.mark.parametrize("integrator", LIMITS)
def test_explicit_methods_blow_up_beyond_their_limit(integrator):
    limit = LIMITS[integrator]
    held, lost = _bounce(integrator, 0.98 * limit), _bounce(integrator, 1.02 * limit)
    assert held.finite
    assert abs(held.q[1]) < 0.02
    assert not lost.finite or abs(lost.q[1]) > 1.0


def test_explicit_euler_has_no_limit():
    motion = _bounce("explicit_euler", 0.2, 600)
    assert abs(motion.q[1]) > 0.5


@pytest.mark.parametrize(
    ("integrator", "survives"),
    [
        ("symplectic_euler", False),
        ("stormer_verlet", False),
        ("rk4", False),
        ("explicit_euler", False),
        ("implicit_euler", True),
        ("implicit_midpoint", True),
        ("reference", True),
    ],
)
def test_environment_at_a_coarse_step(integrator, survives):
    env = gym.make("IntegElasticPendulum-v0", integrator=integrator, dt=0.1)
    env.reset(seed=0)
    ended, status = False, set()
    while not ended:
        *_, terminated, truncated, info = env.step(np.zeros(1))
        status.add(info["solver_status"])
        ended = terminated or truncated
    assert terminated is not survives
    assert ("diverged" in status) is not survives
    if survives:
        assert info["solver_iterations"] >= 1


def test_a_spring_without_give_is_a_rigid_pendulum():
    elastic = ElasticPendulum(stiffness=1e8)
    theta, speed = pi - 0.4, 0.7
    reach = elastic.hanging_length + speed**2 / 1e8
    q = (-reach * sin(theta), elastic.hanging_length + reach * cos(theta))
    v = (-reach * cos(theta) * speed, -reach * sin(theta) * speed)
    engines = (NativeEngine(PlantSystem(p), "implicit_midpoint", 1e-3) for p in (POINT, elastic))
    swing, bob = (
        engine.advance(SCALAR, *state, ((0.0, 500),), None)
        for engine, state in zip(engines, ((((theta,), (speed,))), (q, v)), strict=True)
    )
    assert bob.q[0] == pytest.approx(-sin(swing.q[0]), abs=2e-3)
    assert bob.q[1] - elastic.hanging_length == pytest.approx(cos(swing.q[0]), abs=2e-3)


def test_energy_and_angular_momentum_are_kept():
    plant = ElasticPendulum(gravity=0.0, stiffness=50.0)
    system = PlantSystem(plant)
    q, v = (0.3, 0.2), (1.0, -0.5)
    end = NativeEngine(system, "reference", 0.05).advance(SCALAR, q, v, ((0.0, 100),), None)

    def spin(q, v):
        return q[0] * v[1] - (q[1] - plant.hanging_length) * v[0]

    assert spin(end.q, end.v) == pytest.approx(spin(q, v), abs=1e-10)
    before, after = (system.energy(SCALAR, *s) for s in ((q, v), (end.q, end.v)))
    assert after == pytest.approx(before, abs=1e-10)


def test_starts_are_pushes_from_rest():
    env = gym.make("IntegElasticPendulum-v0")
    pushes = []
    for seed in range(50):
        env.reset(seed=seed)
        x, x_dot, y, y_dot = env.unwrapped.state
        assert (x, y) == (0.0, 0.0)
        assert 1.5 <= x_dot <= 3.0
        assert abs(y_dot) <= 0.3
        pushes.append(x_dot)
    assert min(pushes) < 1.8 < 2.7 < max(pushes)
    env.reset(seed=0, options={"push": 0.2})
    assert abs(env.unwrapped.state[1]) <= 0.2
    with pytest.raises(ValueError, match="reset option `push` must be finite"):
        env.reset(options={"push": -1.0})
