"""Scalars, NumPy arrays and JAX arrays give the same physics from the same code."""

from __future__ import annotations

from dataclasses import fields

import jax
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from motions import ALL, draw_configuration
from pairing import pairs

from integ_gym.envs.engines.stepping import NativeEngine
from integ_gym.envs.ops.compiling import compile_trace
from integ_gym.envs.ops.dialects import SCALARS
from integ_gym.envs.ops.jax_ops import JaxOps
from integ_gym.envs.ops.ops import ARRAY, SCALAR, Ops
from integ_gym.envs.plants.interface import controls_of
from integ_gym.envs.plants.system import PlantSystem
from integ_gym.envs.registries import PLANTS

LANES = 7
PLANTS_AND_FORCES = {
    f"{name}{'-rough' if rough else ''}": (owner, rough)
    for name in PLANTS.names()
    for rough in (False, True)
    if (owner := PLANTS.load(name)) and (not rough or hasattr(owner, "stops"))
}
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


def _cases(owner, rough, count):
    """Parameters, states, controls and dt of lanes, all at random.

    Parameters are within a factor of two of the defaults, dampings up to 0.5; where ``rough``, with
    friction and stops too. States are around the plant's `probe` where it has one, and steps short:
    on its ground a step that is too long blows up, and then rounding with it.
    """
    rng, n = np.random.default_rng(0), len(owner.coordinates)
    for _ in range(count):
        ranges = {f.name: _range(f, rough) for f in fields(owner)}
        yield (
            {name: rng.uniform(*found, LANES) for name, found in ranges.items() if found},
            tuple(
                draw_configuration(owner, rng, LANES)
                if hasattr(owner, "probe")
                else rng.uniform(-3.0, 3.0, (n, LANES))
            ),
            tuple(rng.uniform(-6.0, 6.0, (n, LANES))),
            rng.uniform(-5.0, 5.0, LANES),
            rng.uniform(1e-4, 1e-3, LANES)
            if hasattr(owner, "probe")
            else rng.uniform(1e-3, 0.03, LANES),
        )


def _advance(ops, owner, integrator, case):
    """Three steps of lanes that differ in parameters, state, control and dt."""
    parameters, q, v, control, dt = case
    system, controls = PlantSystem(owner(**parameters)), controls_of(owner, control)
    system.rates(ops, q, v, controls)  # derived parameters are computed here, not inside a trace
    engine = NativeEngine(system, integrator, dt)
    return engine.advance(ops, q, v, ((controls, 3),), None)


def _flat(motion):
    values = (*motion.q, *motion.v, motion.work, *motion.losses, motion.converged)
    return np.stack([np.broadcast_to(np.asarray(x, dtype=float), LANES) for x in values])


def _assert_same(found, expected, tolerance):
    assert np.isfinite(expected).all()
    np.testing.assert_allclose(found, expected, rtol=tolerance, atol=tolerance)


def _agreement(integrator, forces):
    """Of `reference` rounding decides how it divides its step: at a stop, in friction, and where
    a spring swings faster than the step is long (starts one ulp apart end 7e-11 m/s apart)."""
    divided = forces.endswith("-rough") or forces in ("elastic_pendulum", "hopper")
    return 1e-9 if divided and integrator == "reference" else 1e-12


@pytest.mark.parametrize("forces", PLANTS_AND_FORCES)
@pytest.mark.parametrize("integrator", ALL)
def test_array_equals_scalar(forces, integrator):
    owner, rough = PLANTS_AND_FORCES[forces]
    for case in _cases(owner, rough, 1 if integrator == "reference" else 3):
        batched = _flat(_advance(ARRAY, owner, integrator, case))
        lanes = [jax.tree.map(lambda x, i=i: float(x[i]), case) for i in range(LANES)]
        single = [_flat(_advance(SCALAR, owner, integrator, lane))[:, 0] for lane in lanes]
        _assert_same(np.stack(single, -1), batched, _agreement(integrator, forces))


@pytest.mark.parametrize(
    ("integrator", "forces"), pairs(ALL, list(PLANTS_AND_FORCES)[::-1], strength=1)
)
def test_jax_equals_array(integrator, forces):
    """Every integrator and every plant once, and mapped over lanes as in a batch.

    Both are written over the same few operations, and neither knows the other: what one operation
    did otherwise in JAX shows wherever it is used. Each pair is run on arrays above.
    """
    owner, rough = PLANTS_AND_FORCES[forces]

    def advance(case):
        return _advance(JaxOps("float64"), owner, integrator, case)

    step, mapped = jax.jit(advance), jax.jit(jax.vmap(advance))
    for place, case in enumerate(_cases(owner, rough, 5)):
        batched = _flat(_advance(ARRAY, owner, integrator, case))
        with jax.enable_x64(True):
            _assert_same(_flat(step(case)), batched, _agreement(integrator, forces))
            if not place and integrator in ("implicit_midpoint", "symplectic_euler"):
                _assert_same(_flat(mapped(case)), batched, 1e-12)


@pytest.mark.parametrize("integrator", ALL)
def test_float32_converges_and_is_close(integrator):
    engine = NativeEngine(PlantSystem(PLANTS.load("cart_pole")(damping=0.02)), integrator, 0.02)
    (_, q, v, control, _), *_ = _cases(PLANTS.load("cart_pole"), False, 1)
    double = engine.advance(ARRAY, q, v, (((control,), 1),), None)
    single = tuple(np.float32(x) for x in q), tuple(np.float32(x) for x in v)
    ops = JaxOps("float32")
    motion = jax.jit(lambda q, v, u: engine.advance(ops, q, v, (((u,), 1),), None))(
        *single, np.float32(control)
    )
    assert motion.q[0].dtype == np.float32
    assert np.all(np.broadcast_to(np.asarray(motion.converged), LANES))
    for got, expected in zip((*motion.q, *motion.v), (*double.q, *double.v), strict=True):
        np.testing.assert_allclose(got, expected, rtol=2e-5, atol=2e-5)


@given(x=st.floats(), y=st.floats())
@settings(max_examples=100)
def test_elementary_functions_agree_outside_their_domain(x, y):
    with np.errstate(all="ignore"):
        for name in ("sin", "cos", "sqrt"):
            scalar, array = getattr(SCALAR, name)(x), getattr(ARRAY, name)(np.float64(x))
            np.testing.assert_allclose(scalar, array, rtol=1e-14, atol=1e-300)
        for name in ("minimum", "maximum"):
            scalar, array = (getattr(ops, name)(x, y) for ops in (SCALAR, ARRAY))
            assert np.array_equal(scalar, array, equal_nan=True)  # of two zeros NumPy gives either


def _halve(carry):
    return 0.5 * carry[0], carry[1] + 0.1 * carry[0]


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
}
"""By operation, an expression of it."""


def test_every_operation_has_a_sweep():
    operations = {name for name in vars(Ops) if not name.startswith("_")}
    assert operations - {"any", "assume_true", "assume_false"} <= set(_TO_THE_BIT)


@pytest.mark.parametrize("operation", _TO_THE_BIT)
def test_floats_and_arrays_agree_to_the_last_bit(operation):
    """Of numbers of all sizes. Else a single environment and a lane of many would part."""
    rng, expression = np.random.default_rng(0), _TO_THE_BIT[operation]
    traced = compile_trace(SCALARS, expression, False, False)
    sizes = np.ldexp(rng.uniform(-1.0, 1.0, 2_000), rng.integers(-200, 200, 2_000))
    spans = rng.uniform(-10.0, 10.0, 2_000), rng.uniform(-1e6, 1e6, 2_000)
    x = np.concatenate([*spans, sizes, np.arange(-5.0, 0.0), np.arange(1.0, 6.0)])
    y = np.roll(x, 7)
    together = expression(ARRAY, x, y)
    pairs = list(zip(x.tolist(), y.tolist(), strict=True))
    np.testing.assert_array_equal([expression(SCALAR, *pair) for pair in pairs], together)
    np.testing.assert_array_equal([traced(*pair) for pair in pairs], together)
    np.testing.assert_array_equal(expression(ARRAY, x[:3], y[:3]), together[:3])
