"""The traced step of one environment and of many lanes does what the plain one does."""

import math
import pickle
import sys
from functools import partial

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from motions import draw_configuration
from pairing import pairs
from sameness import assert_same
from variants import VARIANTS

from integ_gym.envs.environment import environment_setup
from integ_gym.envs.integrators.interface import Step
from integ_gym.envs.ops.compiling import LaneLoop, compile_trace
from integ_gym.envs.ops.dialects import ARRAYS, SCALARS
from integ_gym.envs.ops.ops import ARRAY, SCALAR, NotTraceable, Unusual, along, leaves_of
from integ_gym.envs.registries import ENVIRONMENTS, INTEGRATORS
from integ_gym.envs.steps import (
    WARM_UP,
    LanesStep,
    compiled_array_step,
    plain_array_step,
    trace_function,
)
from integ_gym.envs.transition import (
    DIVERGED,
    EnvState,
    array_step,
    initial_state,
    scalar_step,
)

LANES = 6

every_step = pytest.mark.parametrize(
    ("integrator", "env_id", "variant"), pairs(INTEGRATORS.names(), ENVIRONMENTS, VARIANTS)
)


def _setup(env_id, integrator, variant):
    return environment_setup(env_id, {"integrator": integrator, **VARIANTS[variant]})


def _given(setup, rng, action):
    """What a step takes beside its state."""
    drawn = rng.random((2, *np.shape(action)))
    numbers = tuple(drawn if np.ndim(action) else drawn.tolist())
    entries = tuple(action / (1 + k) for k in range(setup.action_size))
    return (*(numbers,) * setup.timing.drawn, entries)


def _actions(setup, rng, shape):
    if setup.task.discrete is not None:
        return rng.integers(setup.task.discrete, size=shape).astype(float)
    limit = 2.0 * setup.largest_controls[0]
    return rng.uniform(-limit, limit, shape)


@every_step
def test_a_traced_step_equals_the_plain_one_to_the_bit(env_id, integrator, variant):
    setup = _setup(env_id, integrator, variant)
    plain, step = partial(scalar_step, setup, SCALAR), trace_function(setup, scalar_step)
    assert step is not None
    rng, count = np.random.default_rng(1), len(setup.plant.coordinates)
    q, v = draw_configuration(setup.plant, rng), rng.normal(0.0, 2.0, count)
    state = initial_state(SCALAR, setup, tuple(q.tolist()), tuple(v.tolist()))
    unusual = [math.nan] if setup.task.discrete is not None else [math.nan, math.inf]
    for action in (*_actions(setup, rng, 18).tolist(), *unusual):
        given = _given(setup, rng, action)
        expected = plain(state, *given)
        if math.isfinite(action):
            assert repr(step(state, *given)) == repr(expected)
        else:
            with pytest.raises(Unusual):
                step(state, *given)
        state = EnvState._make(expected[0])


def _lanes(setup, speed=2.0):
    rng = np.random.default_rng(1)
    count = len(setup.plant.coordinates)
    q, v = draw_configuration(setup.plant, rng, LANES), rng.normal(0.0, speed, (count, LANES))
    state = initial_state(ARRAY, setup, tuple(q), tuple(v))
    return state._replace(steps=np.zeros(LANES, dtype=np.int64))


@every_step
def test_a_traced_step_of_lanes_equals_the_plain_one(env_id, integrator, variant):
    setup = _setup(env_id, integrator, variant)
    plain, step = plain_array_step(setup), trace_function(setup, array_step)
    state, rng = _lanes(setup), np.random.default_rng(2)
    taken = step.first(state)
    for _ in range(12):
        given = _given(setup, rng, _actions(setup, rng, LANES))
        with np.errstate(all="ignore"):
            *trees, known = plain(state, *given)
            *found, told, taken = step.step(state, taken, *given)
        told = {**told, **step.alike}
        assert told.keys() == known.keys()
        leaves = zip(leaves_of(tuple(found)), leaves_of(tuple(trees)), strict=True)
        for a, b in (*leaves, *((told[name], known[name]) for name in told)):
            np.testing.assert_array_equal(*np.broadcast_arrays(a, b))
        state = EnvState._make(found[0])


def _run(make, **arguments):
    env = make(**arguments)
    env.action_space.seed(0)
    run = [env.reset(seed=5)]
    for _ in range(WARM_UP + 30):
        run.append(env.step(env.action_space.sample()))
        if not np.ndim(run[-1][2]) and (run[-1][2] or run[-1][3]):
            run.append(env.reset(seed=6))
    return run


@pytest.mark.parametrize("env_id", ENVIRONMENTS)
def test_an_environment_is_the_same_before_and_after_it_is_traced(env_id, monkeypatch):
    for make, integrator, place, given in (
        (gym.make, "rk4", "environment", {"observation_noise": 0.01}),
        (partial(gym.make_vec, num_envs=LANES), "implicit_midpoint", "steps", {}),
    ):
        arguments = {"id": env_id, "dt": 0.02, "integrator": integrator, **given}
        traced = _run(make, **arguments)
        never = math.inf if make is gym.make else 0
        monkeypatch.setattr(f"integ_gym.envs.{place}.WARM_UP", never)
        assert_same(traced, _run(make, **arguments))


@pytest.mark.parametrize("integrator", INTEGRATORS.names())
def test_a_motion_that_diverges_does_so_in_both(integrator):
    setup = environment_setup("IntegCartPole-v0", {"integrator": integrator, "dt": 0.5})
    state = initial_state(SCALAR, setup, (0.0, 1.0), (0.0, 999.9))
    plain, step = partial(scalar_step, setup, SCALAR), trace_function(setup, scalar_step)
    statuses = []
    for _ in range(1 if integrator == "reference" else 4):
        expected = plain(state, (1.0,))
        try:
            found = step(state, (1.0,))
        except (ArithmeticError, ValueError):
            found = expected
        assert repr(found) == repr(expected)
        statuses.append(expected[5]["solver_status"])
        state = EnvState._make(expected[0])
    assert integrator not in ("explicit_euler", "rk4") or DIVERGED in statuses


def _warm(setup, state):
    step = LanesStep(setup)
    for _ in range(WARM_UP):
        step(state, (np.zeros(LANES),))
    return step


def test_one_lane_that_is_unusual_is_the_plain_steps_affair():
    """An action that is not finite, and a divergence."""
    setup = environment_setup("IntegPendulum-v0", {"integrator": "explicit_euler", "dt": 0.5})
    state, step = _lanes(setup), trace_function(setup, array_step)
    for wrong in (math.nan, math.inf):
        actions = np.zeros(LANES)
        actions[2] = wrong
        with pytest.raises(Unusual):
            step.step(state, step.first(state), (actions,))
        _, _, told = _warm(setup, state)(state, (actions,))
        assert told["fallback_used"].tolist() == [lane == 2 for lane in range(LANES)]
    state.q[0][3], state.v[0][3] = 1.5, 999.9
    actions = np.full(LANES, 2.0)
    with pytest.raises(Unusual), np.errstate(all="ignore"):
        step.step(state, step.first(state), (actions,))
    after, _, told = _warm(setup, state)(state, (actions,))
    assert (told["solver_status"] == DIVERGED).tolist() == [lane == 3 for lane in range(LANES)]
    assert after.v[0][3] == 999.9


class Hesitant:
    """Explicit Euler that asks for the value of a component."""

    def step(self, ops, system, q, v, losses, control, dt):
        acceleration, rates = system.rates(ops, q, v, control)
        if v[0] > 0.0:
            acceleration = tuple(1.0 * a for a in acceleration)
        return Step(along(q, dt, v), along(v, dt, acceleration), along(losses, dt, rates))


def test_what_cannot_be_traced_runs_as_it_is_written():
    own = gym.make("IntegPendulum-v0", integrator=f"{__name__}:Hesitant")
    euler = gym.make("IntegPendulum-v0", integrator="explicit_euler")
    assert trace_function(own.unwrapped.setup, scalar_step) is None
    own.reset(seed=0)
    euler.reset(seed=0)
    for _ in range(WARM_UP + 5):
        assert own.step([0.5])[0].tolist() == euler.step([0.5])[0].tolist()


def _hailstone(ops, start):
    """Steps of the 3n + 1 sequence until 1 is reached, with a loop in a loop for the halving."""

    def advance(carry):
        value, steps, peak = carry
        odd = value % 2.0 == 1.0
        value = ops.where(odd, 3.0 * value + 1.0, value)
        steps = ops.where(odd, steps + 1, steps)
        halved = ops.while_loop(
            lambda c: c[0] % 2.0 == 0.0, lambda c: (c[0] / 2.0, c[1] + 1), (value, steps)
        )
        return (*halved, ops.maximum(peak, value))

    return ops.while_loop(lambda carry: carry[0] > 1.0, advance, (start, 0, start))


def test_nested_loops_are_left_one_by_one():
    starts, found = (1.0, 6.0, 27.0), [(1.0, 0, 1.0), (1.0, 8, 16.0), (1.0, 111, 9232.0)]
    assert [compile_trace(SCALARS, _hailstone, False)(start) for start in starts] == found
    lanes = compile_trace(ARRAYS, _hailstone, False)(np.array(starts))
    np.testing.assert_array_equal(np.array(lanes).T, found)


@pytest.mark.parametrize("x", [0.0, 2.0])
@pytest.mark.parametrize(
    "function",
    [
        lambda ops, x: ops.where(x == 0.0, 0.0, 1.0 / x),
        lambda ops, x: ops.where(x == 0.0, 0.0, 3.0 % x),
        lambda ops, x: (x, 1.0 / x)[0],
        lambda ops, x: (x > 0.0) & (1.0 / x > 0.0),
        lambda ops, x: ops.where(x > 1e3, (1e200 + x) ** 2, x),
        lambda ops, x: (ops.repeat(2, lambda k, c: (c[0] + 1.0 / (x + k),), (0.0,)), x)[1],
    ],
)
def test_what_raises_where_nobody_needs_it_raises(function, x):
    made = compile_trace(SCALARS, function, False)
    try:
        expected = repr(function(SCALAR, x))
    except ArithmeticError as error:
        with pytest.raises(type(error)):
            made(x)
        return
    assert repr(made(x)) == expected


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


def test_parameters_that_differ_between_lanes_are_not_traced():
    setup = environment_setup("IntegPendulum-v0", {"mass": np.array([1.0, 2.0])})
    assert trace_function(setup, array_step) is None
    with pytest.raises(NotTraceable):
        compile_trace(ARRAYS, lambda ops, x: np.ones(2) * x, False)


COMPILED = 7


def _both(env_id, **arguments):
    pair = [gym.make_vec(env_id, num_envs=COMPILED, compiled=c, **arguments) for c in (False, True)]
    pair[0].action_space.seed(3)
    return pair


def _compare(plain, made, steps=250, reset_ended=False):
    assert_same(made.reset(seed=5), plain.reset(seed=5))
    for _ in range(steps):
        actions = plain.action_space.sample()
        expected = plain.step(actions)
        assert_same(made.step(actions), expected)
        if reset_ended and (ended := expected[2] | expected[3]).any():
            options = {"reset_mask": ended}
            assert_same(made.reset(options=dict(options)), plain.reset(options=dict(options)))
    np.testing.assert_array_equal(made.unwrapped.state, plain.unwrapped.state)


@pytest.mark.parametrize(
    ("compiled", "numba", "expected"),
    [(None, True, True), (False, True, False), (None, False, False)],
)
def test_lanes_that_have_taken_long_are_compiled(compiled, numba, expected, monkeypatch):
    """In the midst of an episode, where Numba is there and wanted, to the same numbers.

    Traced steps leave numbers in the state, in the place of arrays.
    """
    monkeypatch.setattr("integ_gym.envs.steps.TRACE_AFTER", 0.0)
    monkeypatch.setattr("integ_gym.envs.steps.find_spec", lambda name: numba or None)
    arguments = {"num_envs": COMPILED, "integrator": "rk4", "dt": 0.05, "action_latency": 0.05}
    found, plain = (
        gym.make_vec("IntegPendulum-v0", compiled=c, **arguments) for c in (compiled, False)
    )
    plain.action_space.seed(3)
    assert_same(found.reset(seed=5), plain.reset(seed=5))
    for limit in (math.inf, 0.0):
        monkeypatch.setattr("integ_gym.envs.steps.COMPILE_AFTER", limit)
        for _ in range(5):
            actions = plain.action_space.sample()
            assert_same(found.step(actions), plain.step(actions))
    made = found.unwrapped._steps[0]._traced.step
    assert isinstance(made, LaneLoop) is expected


@pytest.mark.parametrize(("name", "dt"), [("load", 0.04), ("_build_step", 0.03)])
def test_lanes_go_on_where_numba_fails_unasked(name, dt, monkeypatch):
    """At its import or its compilation; a copy goes on likewise, and who asks is told."""
    monkeypatch.setattr("integ_gym.envs.steps.TRACE_AFTER", 0.0)
    monkeypatch.setattr("integ_gym.envs.steps.COMPILE_AFTER", 0.0)

    def fail(*arguments):
        raise ImportError("Numba needs an older NumPy")

    monkeypatch.setattr(f"integ_gym.envs.ops.compiling.{name}", fail)
    actions = np.ones((COMPILED, 1), np.float32)

    def play(compiled):
        made = {"num_envs": COMPILED, "integrator": "rk4", "dt": dt, "compiled": compiled}
        env = gym.make_vec("IntegPendulum-v0", **made).unwrapped
        told = [env.reset(seed=5), *(env.step(actions) for _ in range(4))]
        return [*told, pickle.loads(pickle.dumps(env)).step(actions)]

    assert_same(play(None), play(False))
    with pytest.raises(ImportError, match="older NumPy"):
        play(True)


def test_the_time_of_lanes_counts_for_all_of_a_setup(monkeypatch):
    """An environment is compiled at once that is made where another has taken long."""
    monkeypatch.setattr("integ_gym.envs.steps.TRACE_AFTER", 0.0)
    arguments = {"num_envs": COMPILED, "integrator": "rk4", "dt": 0.0625}
    loops = []
    for limit in (1e9, 1e-9):
        monkeypatch.setattr("integ_gym.envs.steps.COMPILE_AFTER", limit)
        env = gym.make_vec("IntegPendulum-v0", **arguments)
        env.reset(seed=0)
        env.step(np.zeros((COMPILED, 1)))
        loops.append(isinstance(env.unwrapped._steps[0]._traced.step, LaneLoop))
        env.step(np.zeros((COMPILED, 1)))
    assert loops == [False, True]


@pytest.mark.parametrize("integrator", ["symplectic_euler", "stormer_verlet", "reference"])
def test_a_method_of_each_kind_gives_the_same_numbers(integrator):
    """An explicit one, one that solves, and the truth; all others in `make test-slow`."""
    _compare(*_both("IntegCartPole-v0", integrator=integrator))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("integrator", "env_id", "variant"), pairs(sorted(INTEGRATORS.names()), ENVIRONMENTS, VARIANTS)
)
def test_every_variant_gives_the_same_numbers(env_id, integrator, variant):
    _compare(*_both(env_id, integrator=integrator, **VARIANTS[variant]))


@pytest.mark.parametrize("mode", AutoresetMode)
def test_episodes_begin_anew_alike(mode):
    given = {"integrator": "symplectic_euler", "hold_probability": 0.2}
    pair = _both("IntegCartPole-v0", autoreset_mode=mode, **given)
    _compare(*pair, steps=100, reset_ended=mode is AutoresetMode.DISABLED)


@pytest.mark.parametrize("periods", [(0.05, 0.05), (0.05, 0.1)])
def test_members_of_a_mixture_are_compiled_one_by_one(periods):
    mixture = [
        {"integrator": "explicit_euler", "dt": 0.05, "control_period": periods[0]},
        {"integrator": "symplectic_euler", "dt": 0.025, "control_period": periods[1], "weight": 2},
    ]
    _compare(*_both("IntegPendulum-v0", mixture=mixture, action_latency=0.1))


def test_an_action_that_is_not_finite_and_a_lane_that_diverges_are_met_alike():
    plain, made = _both("IntegPendulum-v0", integrator="explicit_euler", dt=0.5)
    fast = np.zeros((COMPILED, 2))
    fast[3] = 1.5, 995.0
    options = {"state": fast}
    assert_same(made.reset(seed=5, options=options), plain.reset(seed=5, options=options))
    ended = []
    for wrong in (2.0, math.nan, 2.0, math.inf):
        actions = np.full((COMPILED, 1), 2.0, dtype=np.float32)
        actions[2] = wrong
        expected = plain.step(actions)
        assert expected[-1]["fallback_used"][2] == (not math.isfinite(wrong))
        assert_same(made.step(actions), expected)
        ended += expected[-1]["solver_status"].tolist()
    assert "diverged" in ended


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"friction": 0.1}, "tanh"),
        ({"mass": np.linspace(1.0, 2.0, COMPILED)}, "differ between lanes"),
        ({"engine": "mujoco", "integrator": "RK4"}, "'RK4' on engine 'mujoco'"),
        ({"compiled": "no"}, "`compiled` must be True or False"),
        ({"mixture": [{"integrator": "rk4"}, {}], "friction": 0.1}, "tanh"),
    ],
)
def test_what_cannot_be_compiled_is_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        gym.make_vec("IntegPendulum-v0", num_envs=COMPILED, **{"compiled": True, **arguments})


def test_without_numba_one_line_says_what_installs_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "numba", None)
    setup = environment_setup("IntegPendulum-v0", {"mass": 1.25})
    with pytest.raises(ModuleNotFoundError, match=r'pip install -e "\.\[numba\]"'):
        compiled_array_step(setup)
