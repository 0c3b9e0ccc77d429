"""Scalars, NumPy arrays and JAX arrays give the same physics from the same code."""

from __future__ import annotations

from dataclasses import fields

import jax
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from motions import ALL, DRIVEN_PLANTS
from pairing import covering

from integ_gym.envs.engines.stepping import NativeEngine, PlantSystem
from integ_gym.envs.ops.compiling import compile_trace
from integ_gym.envs.ops.dialects import SCALARS
from integ_gym.envs.ops.jax_ops import JaxOps
from integ_gym.envs.ops.ops import ARRAY, SCALAR, Ops
from integ_gym.envs.registries import PLANTS

LANES = 7
PLANTS_AND_FORCES = {
    f"{name}{'-rough' if rough else ''}": (owner, rough)
    for name in PLANTS.names()
    for rough in (False, True)
    if (owner := PLANTS.load(name)) and (not rough or hasattr(owner, "stops"))
}


def _states(plant, seed: int = 0):
    rng = np.random.default_rng(seed)
    n = len(plant.coordinates)
    q = tuple(rng.uniform(-3.0, 3.0, LANES) for _ in range(n))
    v = tuple(rng.uniform(-6.0, 6.0, LANES) for _ in range(n))
    return q, v, rng.uniform(-5.0, 5.0, LANES)


def _flat(motion):
    values = (*motion.q, *motion.v, motion.work, *motion.losses, motion.converged)
    return np.stack([np.broadcast_to(np.asarray(x, dtype=float), LANES) for x in values])


def _advance(ops, owner, integrator, case):
    """Three steps of lanes that differ in parameters, state, control and dt."""
    parameters, q, v, control, dt = case
    system = PlantSystem(owner(**parameters))
    system.rates(ops, q, v, control)  # derived parameters are computed here, not inside a trace
    engine = NativeEngine(system, integrator, dt)
    return engine.advance(ops, q, v, ((control, 3),), None)


def _lane(case, i):
    parameters, q, v, control, dt = case
    own = {name: float(values[i]) for name, values in parameters.items()}
    return (
        own, tuple(float(x[i]) for x in q), tuple(float(x[i]) for x in v),
        float(control[i]), float(dt[i]),
    )  # fmt: skip


def _lanes(low, high):
    return arrays(np.float64, LANES, elements=st.floats(low, high))


ROUGH = {
    "friction_speed": (0.2, 1.0), "stop_stiffness": (10.0, 500.0), "joint_limit": (0.3, 2.0),
    "track_limit": (0.3, 2.0),
}  # fmt: skip
"""Ranges of what only friction and stops have."""


def _range(field, rough):
    """Where a parameter is drawn from, or None where it keeps its default."""
    if field.name in ROUGH:
        return ROUGH[field.name] if rough else None
    resisting = field.name.startswith("stop") or field.name.endswith("friction")
    if not isinstance(field.default, float) or (resisting and not rough):
        return None
    return (0.5 * field.default, 2.0 * field.default) if field.default else (0.0, 0.5)


def cases(owner, rough):
    """Parameters within a factor of two of the defaults, dampings up to 0.5, and all the rest.

    Where ``rough``, with friction and stops too.
    """
    n = len(owner.coordinates)
    ranges = {f.name: _range(f, rough) for f in fields(owner)}
    parameters = {name: _lanes(*found) for name, found in ranges.items() if found}
    return st.tuples(
        st.fixed_dictionaries(parameters),
        st.tuples(*[_lanes(-3.0, 3.0)] * n),
        st.tuples(*[_lanes(-6.0, 6.0)] * n),
        _lanes(-5.0, 5.0),
        _lanes(1e-3, 0.03),
    )


def _assert_same(found, expected, tolerance=1e-12):
    assert np.isfinite(expected).all()
    np.testing.assert_allclose(found, expected, rtol=tolerance, atol=tolerance)


def _agreement(integrator, forces, rough):
    """Of `reference` rounding decides how it divides its step: at a stop, in friction, and where
    a spring swings faster than the step is long (starts one ulp apart end 7e-11 m/s apart)."""
    divided = rough or forces == "elastic_pendulum"
    return 1e-9 if divided and integrator == "reference" else 1e-12


@pytest.mark.parametrize("forces", PLANTS_AND_FORCES)
@pytest.mark.parametrize("integrator", ALL)
def test_array_equals_scalar(forces, integrator):
    owner, rough = PLANTS_AND_FORCES[forces]

    @given(cases(owner, rough))
    @settings(max_examples=10, deadline=None)
    def check(case):
        batched = _flat(_advance(ARRAY, owner, integrator, case))
        single = [_flat(_advance(SCALAR, owner, integrator, _lane(case, i))) for i in range(LANES)]
        found = np.stack([lane[:, 0] for lane in single], -1)
        _assert_same(found, batched, _agreement(integrator, forces, rough))

    check()


@pytest.mark.parametrize(("integrator", "forces"), covering(ALL, PLANTS_AND_FORCES, strength=1))
def test_jax_equals_array(integrator, forces):
    """Every integrator and every plant once; each pair in `make test-slow`.

    Both are written over the same few operations, and neither knows the other: what one operation
    did otherwise in JAX shows wherever it is used. Each pair is run on arrays above.
    """
    owner, rough = PLANTS_AND_FORCES[forces]
    ops = JaxOps("float64")
    step = jax.jit(lambda case: _advance(ops, owner, integrator, case))

    @given(cases(owner, rough))
    @settings(max_examples=10, deadline=None)
    def check(case):
        batched = _flat(_advance(ARRAY, owner, integrator, case))
        with jax.enable_x64(True):
            compiled = _flat(step(case))
        _assert_same(compiled, batched, _agreement(integrator, forces, rough))

    check()


@pytest.mark.parametrize("integrator", ALL)
def test_vmap_equals_array(integrator):
    plant = DRIVEN_PLANTS["cart_pole"]
    engine = NativeEngine(PlantSystem(plant), integrator, 0.04)
    q, v, control = _states(plant)
    batched = _flat(engine.advance(ARRAY, q, v, ((control, 3),), None))
    with jax.enable_x64(True):
        ops = JaxOps("float64")
        step = jax.vmap(lambda q, v, u: engine.advance(ops, q, v, ((u, 3),), None))
        mapped = _flat(jax.jit(step)(q, v, control))
    _assert_same(mapped, batched)


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
            scalar, array = (getattr(ops, name)(x, y) for ops in (SCALAR, ARRAY))
            assert np.array_equal(scalar, array, equal_nan=True)  # of two zeros NumPy gives either


def _numbers() -> np.ndarray:
    """Of all sizes, whole ones and zeros among them."""
    rng = np.random.default_rng(0)
    sizes = np.ldexp(rng.uniform(-1.0, 1.0, 5_000), rng.integers(-200, 200, 5_000))
    return np.concatenate(
        [
            rng.uniform(-10.0, 10.0, 5_000),
            rng.uniform(-1e6, 1e6, 5_000),
            sizes,
            np.arange(-5.0, 6.0),
        ]
    )


_X = _numbers()
_Y = np.roll(_X, 7)
_TO_THE_BIT = {
    "sin": lambda ops, x, y: ops.sin(x),
    "cos": lambda ops, x, y: ops.cos(x),
    "tanh": lambda ops, x, y: ops.tanh(x),
    "sqrt": lambda ops, x, y: ops.sqrt(abs(x)),
    "floor": lambda ops, x, y: ops.floor(x),
    "isfinite": lambda ops, x, y: ops.where(ops.isfinite(x), 1.0, 0.0),
    "where": lambda ops, x, y: ops.where(x > y, x, y),
    "minimum": lambda ops, x, y: ops.minimum(x, y),
    "maximum": lambda ops, x, y: ops.maximum(x, y),
    "while_loop": lambda ops, x, y: ops.while_loop(lambda c: abs(c[0]) > 1.0, _halve, (x, 0.0 * x))[
        1
    ],
    "repeat": lambda ops, x, y: ops.repeat(3, lambda i, c: (c[0] * 0.7 + y,), (x,))[0],
    "foreign": lambda ops, x, y: ops.foreign(lambda z: (z * 0.3,), (x,), (False,))[0],
    "%": lambda ops, x, y: x % 0.7,
    "the power of `reference`": lambda ops, x, y: abs(x) ** (-1.0 / 8.0),
}
"""By operation, an expression of it."""


def _halve(carry):
    return 0.5 * carry[0], carry[1] + 0.1 * carry[0]


def test_every_operation_has_a_sweep():
    operations = {name for name in vars(Ops) if not name.startswith("_")} - {
        "any",
        "assume_true",
        "assume_false",
    }
    assert operations <= set(_TO_THE_BIT)


@pytest.mark.parametrize("operation", _TO_THE_BIT)
def test_floats_and_arrays_agree_to_the_last_bit(operation):
    """Else a single environment and a lane of many would part."""
    expression = _TO_THE_BIT[operation]
    traced = compile_trace(SCALARS, expression, False, False)
    x, y = _X[_X != 0.0], _Y[_X != 0.0]
    together = expression(ARRAY, x, y)
    pairs = list(zip(x.tolist(), y.tolist(), strict=True))
    np.testing.assert_array_equal([expression(SCALAR, *pair) for pair in pairs], together)
    np.testing.assert_array_equal([traced(*pair) for pair in pairs], together)
    np.testing.assert_array_equal(expression(ARRAY, x[:3], y[:3]), together[:3])


def test_array_loop_freezes_finished_lanes():
    limit = np.array([0.0, 3.0, 7.0])
    counted = ARRAY.while_loop(
        lambda c: c[0] < limit, lambda c: (c[0] + 1.0, c[1] + 10.0), (np.zeros(3), np.zeros(3))
    )
    np.testing.assert_array_equal(counted, [[0, 3, 7], [0, 30, 70]])
