"""The traced step of many lanes does what the plain one does: the same numbers."""

from __future__ import annotations

import math

import gymnasium as gym
import numpy as np
import pytest
from variants import VARIANTS

from integ_gym.envs.environment import environment_setup
from integ_gym.envs.ops.compiling import compile_trace
from integ_gym.envs.ops.dialects import ARRAYS
from integ_gym.envs.ops.ops import ARRAY, NotTraceable, Unusual, leaves_of
from integ_gym.envs.registries import ENVIRONMENTS, INTEGRATORS
from integ_gym.envs.steps import WARM_UP, LanesStep, plain_array_step, trace_function
from integ_gym.envs.transition import DIVERGED, EnvState, array_step, initial_state

LANES = 6


def _start(setup, seed=1, speed=2.0):
    rng = np.random.default_rng(seed)
    count = len(setup.plant.coordinates)
    q, v = rng.normal(0.0, 1.0, (count, LANES)), rng.normal(0.0, speed, (count, LANES))
    state = initial_state(ARRAY, setup, tuple(q), tuple(v))
    return state._replace(steps=np.zeros(LANES, dtype=np.int64))


def _actions(setup, rng):
    if setup.task.discrete is not None:
        return rng.integers(setup.task.discrete, size=LANES).astype(float)
    limit = 2.0 * setup.task.control_limit
    return rng.uniform(-limit, limit, LANES)


def _assert_same(found, expected):
    """Equal numbers; of zeros either sign."""
    *trees, told = found
    *other_trees, other_told = expected
    assert told.keys() == other_told.keys()
    pairs = zip(leaves_of(tuple(trees)), leaves_of(tuple(other_trees)), strict=True)
    for a, b in (*pairs, *((told[name], other_told[name]) for name in told)):
        np.testing.assert_array_equal(*np.broadcast_arrays(a, b))


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("env_id", ENVIRONMENTS)
@pytest.mark.parametrize("integrator", INTEGRATORS.names())
def test_traced_equals_plain(env_id, integrator, variant):
    setup = environment_setup(env_id, {"integrator": integrator, **VARIANTS[variant]})
    plain, step = plain_array_step(setup), trace_function(setup, array_step)
    assert step is not None
    state, rng = _start(setup), np.random.default_rng(2)
    taken = step.first(state)
    for _ in range(12):
        actions = _actions(setup, rng)
        with np.errstate(all="ignore"):
            expected = plain(state, actions)
            *found, told, taken = step.step(state, taken, actions)
        _assert_same((*found, {**told, **step.alike}), expected)
        state = EnvState._make(found[0])


@pytest.mark.parametrize("wrong", [math.nan, math.inf])
def test_one_action_that_is_not_finite_is_the_plain_steps_affair(wrong):
    setup = environment_setup("IntegPendulum-v0", {})
    actions = np.zeros(LANES)
    actions[2] = wrong
    state = _start(setup)
    step = trace_function(setup, array_step)
    with pytest.raises(Unusual):
        step.step(state, step.first(state), actions)
    _, _, told = _warm(setup, state)(state, actions)
    assert told["fallback_used"].tolist() == [lane == 2 for lane in range(LANES)]


def test_one_lane_that_diverges_is_the_plain_steps_affair():
    setup = environment_setup("IntegPendulum-v0", {"integrator": "explicit_euler", "dt": 0.5})
    state = _start(setup)
    state.v[0][3] = 999.9
    actions = np.full(LANES, 2.0)
    state.q[0][3] = 1.5
    step = trace_function(setup, array_step)
    with pytest.raises(Unusual), np.errstate(all="ignore"):
        step.step(state, step.first(state), actions)
    after, _, told = _warm(setup, state)(state, actions)
    assert (told["solver_status"] == DIVERGED).tolist() == [lane == 3 for lane in range(LANES)]
    assert after.v[0][3] == 999.9


def _warm(setup, state):
    step = LanesStep(setup)
    for _ in range(WARM_UP):
        step(state, np.zeros(LANES))
    return step


def _collatz(ops, start):
    """Steps of the 3n + 1 sequence until 1 is reached, with a loop in a loop for the halving."""

    def unfinished(carry):
        return carry[0] > 1.0

    def advance(carry):
        value, steps = carry
        odd = value % 2.0 == 1.0
        value = ops.where(odd, 3.0 * value + 1.0, value)
        steps = ops.where(odd, steps + 1, steps)
        return ops.while_loop(
            lambda c: c[0] % 2.0 == 0.0, lambda c: (c[0] / 2.0, c[1] + 1), (value, steps)
        )

    return ops.while_loop(unfinished, advance, (start, 0))


def test_lanes_leave_nested_loops_one_by_one():
    value, steps = compile_trace(ARRAYS, _collatz, False)(np.array([1.0, 6.0, 27.0]))
    assert value.tolist() == [1.0, 1.0, 1.0]
    assert steps.tolist() == [0, 8, 111]


@pytest.mark.parametrize(
    ("x", "holds"),
    [
        ([9.9] * 6, True), ([-0.1] * 6, True), ([0.1, -10.1], False), ([1e200, 0.0], False),
        ([math.nan, 0.0], False), ([math.inf], False), ([10.0], True),
    ],
)  # fmt: skip
def test_a_bound_is_kept_whatever_the_sum_of_squares(x, holds):
    """Also where many lanes within the bound make a sum beyond it."""

    def function(ops, x):
        return ops.where(ops.assume_true(ops.isfinite(x) & (abs(x) <= 10.0)), x, 0.0)

    made = compile_trace(ARRAYS, function, False)
    assert "dot" in made.__doc__
    if holds:
        assert made(np.array(x)).tolist() == x
        return
    with pytest.raises(Unusual), np.errstate(over="ignore"):
        made(np.array(x))


@pytest.mark.parametrize(
    "operation",
    [
        lambda ops, a, b: a + b,
        lambda ops, a, b: False - b,
        lambda ops, a, b: -a,
        lambda ops, a, b: abs(a),
        lambda ops, a, b: ops.sin(a),
        lambda ops, a, b: ops.sqrt(b),
        lambda ops, a, b: ops.minimum(a, b) + a * b,
    ],
)
def test_arithmetic_on_truth_values_alone_is_not_traced(operation):
    """A sum of two is 2 of floats, True of arrays."""
    with pytest.raises(NotTraceable, match="not the same for floats and arrays"):
        compile_trace(ARRAYS, lambda ops, x: operation(ops, x > 1.0, x > 0.0), False)


@pytest.mark.parametrize(
    ("operation", "result"),
    [
        (lambda x: 0.0 * x, 0.0), (lambda x: x * 0.0, 0.0), (lambda x: 0.0 / x, 0.0),
        (lambda x: 1.0 * x, "x"), (lambda x: x * 1.0, "x"), (lambda x: x / 1.0, "x"),
        (lambda x: x + 0.0, "x"), (lambda x: 0.0 + x, "x"), (lambda x: x - 0.0, "x"),
        (lambda x: 0.0 - x, "-"), (lambda x: (x > 0.0) * 1.0, "*"), (lambda x: 1 * x, "*"),
    ],
)  # fmt: skip
def test_operations_with_zero_and_one_are_not_done_on_lanes(operation, result):
    made = compile_trace(ARRAYS, lambda ops, x: operation(x), False)
    body = made.__doc__.splitlines()[-1].split("return ")[1]
    assert {"x": body == "x1"}.get(result, str(result) in body), body
    x = np.array([-2.0, 3.0])
    np.testing.assert_array_equal(np.broadcast_to(made(x), 2), operation(x))


def test_parameters_that_differ_between_lanes_are_not_traced():
    setup = environment_setup("IntegPendulum-v0", {"mass": np.array([1.0, 2.0])})
    assert trace_function(setup, array_step) is None
    with pytest.raises(NotTraceable):
        compile_trace(ARRAYS, lambda ops, x: np.ones(2) * x, False)


@pytest.mark.parametrize("env_id", ENVIRONMENTS)
def test_a_vector_environment_is_the_same_before_and_after_it_is_traced(env_id, monkeypatch):
    traced = _run(env_id)
    monkeypatch.setattr("integ_gym.envs.steps.WARM_UP", 0)
    for (*arrays, info), (*expected, told) in zip(traced, _run(env_id), strict=True):
        assert info.keys() == told.keys()
        for a, b in (*zip(arrays, expected, strict=True), *((info[k], told[k]) for k in told)):
            assert (a.dtype, a.shape) == (b.dtype, b.shape)
            np.testing.assert_array_equal(a, b)


def _run(env_id):
    env = gym.make_vec(env_id, num_envs=LANES, dt=0.02, integrator="implicit_midpoint")
    env.action_space.seed(0)
    start = env.reset(seed=5)
    return [start, *(env.step(env.action_space.sample()) for _ in range(WARM_UP + 30))]
