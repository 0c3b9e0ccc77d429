"""The traced step of many lanes does what the plain one does: the same numbers."""

from __future__ import annotations

import math

import gymnasium as gym
import numpy as np
import pytest
from variants import VARIANTS

from integ_gym.envs.environment import environment_setup
from integ_gym.envs.ops.compiling import compiled, repeated
from integ_gym.envs.ops.dialects import ARRAYS
from integ_gym.envs.ops.ops import ARRAY, NotTraceable, Unusual, leaves_of
from integ_gym.envs.registries import ENVIRONMENTS, INTEGRATORS
from integ_gym.envs.steps import WARM_UP, LanesStep, plain_array_step, traced
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
    plain, step = plain_array_step(setup), traced(setup, array_step)
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
    step = traced(setup, array_step)
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
    step = traced(setup, array_step)
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
    value, steps = compiled(ARRAYS, _collatz, False)(np.array([1.0, 6.0, 27.0]))
    assert value.tolist() == [1.0, 1.0, 1.0]
    assert steps.tolist() == [0, 8, 111]


def test_logic_of_lanes_and_constants():
    def function(ops, x, given):
        both = (x > 0.0) & given
        no = both == False  # noqa: E712
        known = ops.usually(True) & ops.any(both)
        return ops.floor(x), no | (x < -1.0), known, ops.maximum(x, 0.0), ops.minimum(1.0, x)

    x = np.array([-1.5, 0.5, 2.5])
    floor, either, known, above, below = compiled(ARRAYS, function, False, True)(x, x < 2.0)
    assert floor.tolist() == [-2.0, 0.0, 2.0]
    assert either.tolist() == [True, False, True]
    assert known
    assert above.tolist() == [0.0, 0.5, 2.5]
    assert below.tolist() == [-1.5, 0.5, 1.0]


def test_what_is_known_not_to_hold_is_no_expectation():
    assert compiled(ARRAYS, lambda ops, x: ops.where(ops.usually(False), x, -x), False)(2.0) == -2.0


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
        return ops.where(ops.usually(ops.isfinite(x) & (abs(x) <= 10.0)), x, 0.0)

    made = compiled(ARRAYS, function, False)
    assert "dot" in made.__doc__
    if holds:
        assert made(np.array(x)).tolist() == x
        return
    with pytest.raises(Unusual), np.errstate(over="ignore"):
        made(np.array(x))


def test_other_expectations_are_looked_at_lane_by_lane():
    made = compiled(ARRAYS, lambda ops, x: ops.where(ops.usually(x > 1.0), x, 0.0), False)
    assert "dot" not in made.__doc__
    assert made(np.array([2.0, 3.0])).tolist() == [2.0, 3.0]
    with pytest.raises(Unusual):
        made(np.array([2.0, 0.5]))


def test_what_is_wanted_in_rare_lanes_is_computed_where_there_are_some():
    def function(ops, x, y):
        rare = ops.rarely(x > 1.0)
        return {"both": rare & (ops.sqrt(y) > 2.0), "rare": x > 1.0, "known": ops.rarely(True)}

    made, y = compiled(ARRAYS, function, False, False), np.array([9.0, 9.0, 1.0])
    told = made(np.array([0.0, 2.0, 2.0]), y)
    assert told["both"].tolist() == [False, True, False]
    assert told["known"] is True
    told = made(np.zeros(3), None)
    assert told["both"].tolist() == [False] * 3
    assert told["both"] is not told["rare"]


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
        compiled(ARRAYS, lambda ops, x: operation(ops, x > 1.0, x > 0.0), False)


def test_a_product_of_truth_values_is_a_truth_value():
    made = compiled(ARRAYS, lambda ops, x: 0.5 * ((x > 0.0) * (x < 2.0)), False)
    assert made(np.array([-1.0, 1.0, 3.0])).tolist() == [0.0, 0.5, 0.0]


@pytest.mark.parametrize("held", [[1.0, 2.0], [2.0, 1.0]])
def test_a_choice_of_two_numbers(held):
    made = compiled(ARRAYS, lambda ops, x: ops.where(x > 0.0, *held), False)
    assert made(np.array([1.0, -1.0])).tolist() == held


def test_values_are_put_into_the_arrays_of_some_lanes():
    """Of a constant and of what was given they are made; what is there twice is written once."""

    def function(ops, state, push):
        (x, kept), *_ = state
        after = x + ops.sin(x) * push
        return ((after, kept), False, after), {"sine": ops.sin(after), "one": 1.0}

    made = repeated(ARRAYS, function, ((False, False), True, False), False)
    assert made.alike == {"one": 1.0}
    x = np.array([0.1, 0.2, 0.3])
    state = (x, 5.0), True, x
    state, _, taken = made.step(state, made.first(state), 1.0)
    before = state[0][0]
    lanes, values = np.array([0, 2]), (np.array([7.0, 8.0]), 9.0, True, np.array([7.0, 8.0]), -1.0)
    ((x, kept), flag, twice), (sine,) = made.put(state, taken, lanes, values)
    assert x is twice is before
    assert x.tolist() == [7.0, before[1], 8.0]
    assert kept.tolist() == [9.0, 5.0, 9.0]
    assert flag.tolist() == [True, False, True]
    assert sine.tolist() == [-1.0, math.sin(before[1]), -1.0]


def test_what_is_known_of_the_next_state_is_passed_on():
    """sin(x) is computed once per call, of the new state, and what nobody needs is not."""

    def function(ops, state, push):
        x, v = state
        after = x + v, v + push * ops.sin(x)
        unused = ops.cos(x) + ops.cos(after[0])
        assert unused is not None
        return after, {"height": ops.sin(after[0]), "speed": after[1]}

    made = repeated(ARRAYS, function, (False, False), False)
    assert made.step.__doc__.count("sin") == made.first.__doc__.count("sin") == 1
    assert "cos" not in made.step.__doc__
    state, push = (np.array([0.1, 0.2]), np.array([1.0, -1.0])), np.array([0.5, 0.5])
    plain, taken = state, made.first(state)
    for _ in range(3):
        state, told, taken = made.step(state, taken, push)
        plain, expected = function(ARRAY, plain, push)
        np.testing.assert_array_equal(state, plain)
        np.testing.assert_array_equal(told["height"], expected["height"])
    assert told["speed"] is not state[1]


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
    made = compiled(ARRAYS, lambda ops, x: operation(x), False)
    body = made.__doc__.splitlines()[-1].split("return ")[1]
    assert {"x": body == "x1"}.get(result, str(result) in body), body
    x = np.array([-2.0, 3.0])
    np.testing.assert_array_equal(np.broadcast_to(made(x), 2), operation(x))


def test_parameters_that_differ_between_lanes_are_not_traced():
    setup = environment_setup("IntegPendulum-v0", {"mass": np.array([1.0, 2.0])})
    assert traced(setup, array_step) is None
    with pytest.raises(NotTraceable):
        compiled(ARRAYS, lambda ops, x: np.ones(2) * x, False)


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
