"""Scalars, NumPy arrays and JAX arrays give the same physics from the same code."""

from __future__ import annotations

import jax
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from motions import ALL, DRIVEN_PLANTS

from integ_gym.envs.array_ops import ARRAY
from integ_gym.envs.engines.native import NativeEngine
from integ_gym.envs.jax_ops import JaxOps
from integ_gym.envs.ops import SCALAR
from integ_gym.envs.system import PlantSystem

LANES = 7


def _states(plant, seed: int = 0):
    rng = np.random.default_rng(seed)
    n = len(plant.coordinates)
    q = tuple(rng.uniform(-3.0, 3.0, LANES) for _ in range(n))
    v = tuple(rng.uniform(-6.0, 6.0, LANES) for _ in range(n))
    return q, v, rng.uniform(-5.0, 5.0, LANES)


def _flat(motion):
    values = (*motion.q, *motion.v, motion.work, *motion.losses, motion.iterations)
    return np.stack([np.broadcast_to(np.asarray(x, dtype=float), LANES) for x in values])


def _scalar_lanes(engine, q, v, control):
    lanes = []
    for i in range(LANES):
        qi, vi = tuple(float(x[i]) for x in q), tuple(float(x[i]) for x in v)
        motion = engine.advance(SCALAR, qi, vi, ((float(control[i]), 3),), None)
        lanes.append((*motion.q, *motion.v, motion.work, *motion.losses, motion.iterations))
    return np.array(lanes).T


@pytest.mark.parametrize("plant", DRIVEN_PLANTS)
@pytest.mark.parametrize("integrator", ALL)
def test_array_equals_scalar(plant, integrator):
    plant = DRIVEN_PLANTS[plant]
    engine = NativeEngine(PlantSystem(plant), integrator, 0.04)
    q, v, control = _states(plant)
    batched = _flat(engine.advance(ARRAY, q, v, ((control, 3),), None))
    np.testing.assert_allclose(batched, _scalar_lanes(engine, q, v, control), rtol=0, atol=1e-12)


@pytest.mark.parametrize("plant", DRIVEN_PLANTS)
@pytest.mark.parametrize("integrator", ALL)
def test_jax_equals_array(plant, integrator):
    plant = DRIVEN_PLANTS[plant]
    engine = NativeEngine(PlantSystem(plant), integrator, 0.04)
    q, v, control = _states(plant)
    batched = _flat(engine.advance(ARRAY, q, v, ((control, 3),), None))
    with jax.enable_x64(True):
        ops = JaxOps("float64")
        step = jax.jit(lambda q, v, u: engine.advance(ops, q, v, ((u, 3),), None))
        compiled = _flat(step(q, v, control))
        mapped = _flat(jax.jit(jax.vmap(step))(q, v, control))
    np.testing.assert_allclose(compiled, batched, rtol=0, atol=1e-12)
    np.testing.assert_allclose(mapped, batched, rtol=0, atol=1e-12)


@pytest.mark.parametrize("integrator", ALL)
def test_float32_converges_and_is_close(integrator):
    plant = DRIVEN_PLANTS["cart_pole"]
    engine = NativeEngine(PlantSystem(plant), integrator, 0.02)
    q, v, control = _states(plant)
    double = engine.advance(ARRAY, q, v, ((control, 1),), None)
    single = tuple(np.float32(x) for x in q), tuple(np.float32(x) for x in v)
    ops = JaxOps("float32")
    motion = jax.jit(lambda q, v, u: engine.advance(ops, q, v, ((u, 1),), None))(
        *single, np.float32(control)
    )
    assert motion.q[0].dtype == np.float32
    assert np.all(np.broadcast_to(np.asarray(motion.converged), LANES))
    for got, expected in zip((*motion.q, *motion.v), (*double.q, *double.v), strict=True):
        np.testing.assert_allclose(got, expected, rtol=2e-5, atol=2e-5)


@given(
    x=st.floats(allow_nan=True, allow_infinity=True),
    y=st.floats(allow_nan=True, allow_infinity=True),
)
@settings(max_examples=200)
def test_elementary_functions_agree_outside_their_domain(x, y):
    with np.errstate(all="ignore"):
        for name in ("sin", "cos", "sqrt"):
            scalar, array = getattr(SCALAR, name)(x), getattr(ARRAY, name)(np.float64(x))
            np.testing.assert_allclose(scalar, array, rtol=1e-14, atol=1e-300)
        for name in ("minimum", "maximum"):
            np.testing.assert_equal(
                float(getattr(SCALAR, name)(x, y)), float(getattr(ARRAY, name)(x, y))
            )


def test_array_loop_freezes_finished_lanes():
    limit = np.array([0.0, 3.0, 7.0])
    counted = ARRAY.while_loop(
        lambda c: c[0] < limit, lambda c: (c[0] + 1.0, c[1] + 10.0), (np.zeros(3), np.zeros(3))
    )
    np.testing.assert_array_equal(counted, [[0, 3, 7], [0, 30, 70]])
