"""The elastic pendulum: physics, and what a stiff spring does to the integrators."""

from math import sqrt

import gymnasium as gym
import pytest

from integ_gym.envs.engines.stepping import NativeEngine
from integ_gym.envs.ops.ops import SCALAR
from integ_gym.envs.plants.elastic_pendulum import ElasticPendulum
from integ_gym.envs.plants.system import PlantSystem

STIFF = ElasticPendulum(stiffness=1000.0)
BOUNCE = sqrt(STIFF.stiffness / STIFF.mass)
LIMITS = {"symplectic_euler": 2.0, "stormer_verlet": 2.0, "rk4": 2.0 * sqrt(2.0)}
"""Largest stable product of step and frequency."""


def _bounce(integrator: str, product: float, steps: int = 400):
    """Motion after a small vertical bounce in steps of ``product`` over the bounce's frequency."""
    engine = NativeEngine(PlantSystem(STIFF), integrator, product / BOUNCE)
    return engine.advance(SCALAR, (0.0, 1e-3), (0.0, 0.0), (((0.0,), steps),), None)


@pytest.mark.parametrize("integrator", LIMITS)
def test_explicit_methods_blow_up_beyond_their_limit(integrator):
    limit = LIMITS[integrator]
    held, lost = _bounce(integrator, 0.98 * limit), _bounce(integrator, 1.02 * limit)
    assert held.finite
    assert abs(held.q[1]) < 0.02
    assert not lost.finite or abs(lost.q[1]) > 1.0


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
