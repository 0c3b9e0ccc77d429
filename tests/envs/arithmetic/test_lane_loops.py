"""The step that Numba compiles gives the numbers of the traced one, and their types."""

from __future__ import annotations

import math
import sys

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from pairing import pairs
from sameness import assert_same
from variants import VARIANTS

from integ_gym.envs.environment import environment_setup
from integ_gym.envs.registries import ENVIRONMENTS, INTEGRATORS
from integ_gym.envs.steps import compiled_array_step

LANES = 7


def _both(env_id, **arguments):
    pair = [gym.make_vec(env_id, num_envs=LANES, compiled=c, **arguments) for c in (False, True)]
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
    fast = np.zeros((LANES, 2))
    fast[3] = 1.5, 995.0
    options = {"state": fast}
    assert_same(made.reset(seed=5, options=options), plain.reset(seed=5, options=options))
    ended = []
    for wrong in (2.0, math.nan, 2.0, math.inf):
        actions = np.full((LANES, 1), 2.0, dtype=np.float32)
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
        ({"mass": np.linspace(1.0, 2.0, LANES)}, "differ between lanes"),
        ({"engine": "mujoco", "integrator": "RK4"}, "'RK4' on engine 'mujoco'"),
        ({"compiled": "no"}, "`compiled` must be True or False"),
        ({"mixture": [{"integrator": "rk4"}, {}], "friction": 0.1}, "tanh"),
    ],
)
def test_what_cannot_be_compiled_is_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        gym.make_vec("IntegPendulum-v0", num_envs=LANES, **{"compiled": True, **arguments})


def test_without_numba_one_line_says_what_installs_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "numba", None)
    setup = environment_setup("IntegPendulum-v0", {"mass": 1.25})
    with pytest.raises(ModuleNotFoundError, match=r'pip install -e "\.\[numba\]"'):
        compiled_array_step(setup)
