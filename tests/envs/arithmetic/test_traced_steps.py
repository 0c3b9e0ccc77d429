"""The traced step does what the plain one does, bit by bit."""

from __future__ import annotations

import math
from functools import partial

import gymnasium as gym
import numpy as np
import pytest
from variants import VARIANTS

from integ_gym.envs.environment import environment_setup
from integ_gym.envs.integrators.interface import Step
from integ_gym.envs.ops.compiling import compile_trace
from integ_gym.envs.ops.dialects import SCALARS
from integ_gym.envs.ops.ops import SCALAR, NotTraceable, Unusual, along
from integ_gym.envs.registries import ENVIRONMENTS, INTEGRATORS
from integ_gym.envs.steps import WARM_UP, trace_function
from integ_gym.envs.transition import DIVERGED, EnvState, initial_state, scalar_step


def _start(setup, seed):
    rng = np.random.default_rng(seed)
    count = len(setup.plant.coordinates)
    q, v = rng.normal(0.0, 1.0, count), rng.normal(0.0, 2.0, count)
    return initial_state(SCALAR, setup, tuple(q.tolist()), tuple(v.tolist()))


def _actions(setup, rng):
    if setup.task.discrete is not None:
        return [*rng.integers(setup.task.discrete, size=18).astype(float).tolist(), math.nan]
    limit = 2.0 * setup.task.control_limit
    return [*rng.uniform(-limit, limit, 18).tolist(), math.nan, math.inf]


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("env_id", ENVIRONMENTS)
@pytest.mark.parametrize("integrator", INTEGRATORS.names())
def test_traced_steps_equal_plain_ones_to_the_bit(env_id, integrator, variant):
    setup = environment_setup(env_id, {"integrator": integrator, **VARIANTS[variant]})
    plain, step = partial(scalar_step, setup, SCALAR), trace_function(setup, scalar_step)
    assert step is not None
    state = _start(setup, 1)
    for action in _actions(setup, np.random.default_rng(2)):
        expected = plain(state, action)
        if math.isfinite(action):
            assert repr(step(state, action)) == repr(expected)
        else:
            with pytest.raises(Unusual):
                step(state, action)
        state = EnvState._make(expected[0])


@pytest.mark.parametrize("env_id", ENVIRONMENTS)
def test_an_environment_is_the_same_before_and_after_it_is_traced(env_id, monkeypatch):
    arguments = {"dt": 0.02, "integrator": "rk4", "observation_noise": 0.01}
    traced = _run(gym.make(env_id, **arguments))
    monkeypatch.setattr("integ_gym.envs.environment.WARM_UP", math.inf)
    assert traced == _run(gym.make(env_id, **arguments))


def _run(env):
    env.action_space.seed(0)
    run = [repr(env.reset(seed=5))]
    for _ in range(WARM_UP + 20):
        step = env.step(env.action_space.sample())
        run.append(repr(step))
        if step[2] or step[3]:
            run.append(repr(env.reset(seed=6)))
    return run


@pytest.mark.parametrize("speed", [900.0, 999.9])
@pytest.mark.parametrize("integrator", INTEGRATORS.names())
def test_a_motion_that_diverges_does_so_in_both(integrator, speed):
    setup = environment_setup("IntegCartPole-v0", {"integrator": integrator, "dt": 0.5})
    state = initial_state(SCALAR, setup, (0.0, 1.0), (0.0, speed))
    plain, step = partial(scalar_step, setup, SCALAR), trace_function(setup, scalar_step)
    statuses = []
    for _ in range(4):
        expected = plain(state, 1.0)
        try:
            found = step(state, 1.0)
        except (ArithmeticError, ValueError):
            found = expected
        assert repr(found) == repr(expected)
        statuses.append(expected[5]["solver_status"])
        state = EnvState._make(expected[0])
    assert integrator not in ("explicit_euler", "rk4") or DIVERGED in statuses


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

    def unfinished(carry):
        return carry[0] > 1.0

    def advance(carry):
        value, steps, peak = carry
        odd = value % 2.0 == 1.0
        value = ops.where(odd, 3.0 * value + 1.0, value)
        steps = ops.where(odd, steps + 1, steps)
        peak = ops.maximum(peak, value)
        halved = ops.while_loop(
            lambda c: c[0] % 2.0 == 0.0, lambda c: (c[0] / 2.0, c[1] + 1), (value, steps)
        )
        return (*halved, peak)

    value, steps, peak = ops.while_loop(unfinished, advance, (start, 0, start))
    return {"value": value, "steps": steps, "peak": peak, "constant": (1.5, True, "text")}


@pytest.mark.parametrize(
    ("start", "steps", "peak"), [(1.0, 0, 1.0), (6.0, 8, 16.0), (27.0, 111, 9232.0)]
)
def test_nested_loops(start, steps, peak):  # fmt: skip
    found = compile_trace(SCALARS, _hailstone, False)(start)
    assert found == _hailstone(SCALAR, start)
    assert (found["steps"], found["peak"]) == (steps, peak)


def test_constants_and_unused_work_leave_no_trace():
    def function(ops, pair):
        unused = ops.sin(pair[0])
        assert unused is not None
        total = ops.repeat(3, lambda k, c: (c[0] + k * pair[1], c[1]), (pair[0], 2.0))
        return ops.where(True, total[0], pair[1]), total[1], ops.maximum(1.0, 2.0)

    made = compile_trace(SCALARS, function, (False, False))
    assert made((1.0, 2.0)) == (7.0, 2.0, 2.0)
    assert "sin" not in made.__doc__


def test_asking_for_a_value_is_refused():
    with pytest.raises(NotTraceable):
        compile_trace(SCALARS, lambda ops, x: 1.0 if x > 0.0 else 2.0, False)


def _same_outcome(function, *values):
    """What the traced function gives or raises is what the plain one does."""
    made = compile_trace(SCALARS, function, *(False for _ in values))
    try:
        expected = repr(function(SCALAR, *values))
    except ArithmeticError as error:
        with pytest.raises(type(error)):
            made(*values)
        return
    assert repr(made(*values)) == expected


@pytest.mark.parametrize("x", [0.0, 2.0])
def test_what_raises_in_a_branch_not_taken_raises(x):
    _same_outcome(lambda ops, x: ops.where(x == 0.0, 0.0, 1.0 / x), x)
    _same_outcome(lambda ops, x: ops.where(x == 0.0, 0.0, 3.0 % x), x)
    _same_outcome(lambda ops, x: (x, 1.0 / x)[0], x)
    _same_outcome(lambda ops, x: (x > 0.0) & (1.0 / x > 0.0), x)
    _same_outcome(lambda ops, x: ops.where(x > 1e3, (1e200 + x) ** 2, x), x)


@pytest.mark.parametrize("x", [0.0, 3.0])
def test_what_raises_in_a_loop_that_nobody_needs_raises(x):
    def function(ops, x):
        ops.repeat(2, lambda k, c: (c[0] + 1.0 / (x + k),), (0.0,))
        return x

    _same_outcome(function, x)
