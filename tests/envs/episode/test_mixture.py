"""Mixtures: what is drawn, with which shares, and that all worlds advance the same."""

from __future__ import annotations

import gymnasium as gym
import jax
import numpy as np
import pytest
from functional_checks import compare, vector_of
from motions import ALL

from integ_gym.envs import functional
from integ_gym.envs.environment import environment_mixture

PERIOD = 0.04
EVERYTHING = [
    {"integrator": name, "dt": dt} for name in ALL for dt in (PERIOD, PERIOD / 2, PERIOD / 4)
]
"""Three steps of every integrator."""

WEIGHTED = [
    {"integrator": "rk4", "dt": 0.04, "weight": 3},
    {"integrator": "rk4", "dt": 0.02},
    {"integrator": "explicit_euler", "dt": 0.04, "weight": 4},
]
PARTS = {"mixture": WEIGHTED, "control_period": PERIOD}


def test_every_integrator_and_step_equals_the_vector_environment():
    """With stops."""
    compare(
        "IntegCartPoleSwingUp-v0",
        {"mixture": EVERYTHING, "control_period": PERIOD},
        5,
        3 * len(ALL),
    )


@pytest.mark.parametrize(
    "arguments",
    [
        {"duration": 0.2},
        {"duration": 0.2, "action_latency": 0.04, "fallback": "zero"},
        {"duration": 0.2, "sensor_period": 0.08},
        {"duration": 0.2, "max_speed": 3.0},
    ],
    ids=["resets", "latency", "sensor", "speed limit"],
)
def test_draws_anew_at_every_reset_as_the_vector_environment(arguments):
    assert compare("IntegPendulum-v0", {**PARTS, **arguments}, 16, 16) == 48


def test_shares_of_a_functional_mixture():
    """Integrators exactly and at every moment, steps within an integrator as they are drawn."""
    env = functional.make(
        "IntegPendulum-v0", mixture=WEIGHTED, control_period=PERIOD, duration=2 * PERIOD
    )
    state = env.initial(jax.random.key(0), lanes=(64,))
    step = jax.jit(env.step)
    coarse = []
    for count in range(200):
        member = np.asarray(state.member[0])
        assert np.bincount(member, minlength=3)[2] == 32
        coarse.append(np.mean(member[member < 2] == 0))
        state, _ = step(state, np.zeros((64, 1), np.float32), jax.random.key(count), None)
    drawn = np.array(coarse[::2])
    np.testing.assert_allclose(drawn.mean(), 0.75, atol=4 * np.sqrt(0.75 * 0.25 / (100 * 32)))
    assert (np.array(coarse[1::2]) == drawn).all()
    assert len(set(drawn)) > 5


def test_one_program_serves_other_values():
    env = functional.make("IntegPendulum-v0", mixture=WEIGHTED, control_period=PERIOD)
    compiled = []

    @jax.jit
    def advance(state, action, params):
        compiled.append(1)
        return env.transition(state, action, jax.random.key(0), params)

    state = env.initial(jax.random.key(0), lanes=(16,))
    action = np.ones((16, 1), np.float32)
    finer = [{**member, "dt": member["dt"] / 2} for member in WEIGHTED]
    for changed in ({}, {"mass": 2.0}, {"mixture": finer}, {"mass": np.linspace(1.0, 2.0, 16)}):
        after = advance(state, action, env.params(**changed))
        own = functional.make(
            "IntegPendulum-v0", **{"mixture": WEIGHTED, "control_period": PERIOD, **changed}
        )
        expected = own.transition(state, action, jax.random.key(0))
        np.testing.assert_allclose(after.env.v[0], expected.env.v[0], rtol=1e-6, atol=1e-6)
    assert len(compiled) == 1 + 1  # once more for one mass per lane
    with pytest.raises(ValueError, match="another program"):
        env.params(mixture=WEIGHTED[:2])
    with pytest.raises(ValueError, match="another program"):
        env.params(max_speed=8.0)


@pytest.mark.parametrize(
    ("changed", "error", "fragments"),
    [
        ({"mixture": []}, ValueError, ["at least one"]),
        ({"mixture": 3}, ValueError, ["must be a list"]),
        ({"mixture": ["rk4"]}, ValueError, ["every member"]),
        ({"mixture": [{"mass": 1.0}]}, ValueError, ["unknown key in `mixture` 'mass'", "weight"]),
        ({"mixture": [{"integrator": "rk5", "dt": 0.04}]}, ValueError, ["Did you mean 'rk4'"]),
        ({"mixture": [{"weight": 0}]}, ValueError, ["`weight`", "above 0"]),
        ({"mixture": [{"weight": "half"}]}, ValueError, ["`weight`", "'half'"]),
        ({"mixture": [{"dt": 0.03}]}, ValueError, ["not a whole multiple"]),
        ({"control_period": None}, ValueError, ["one control period", "0.02, 0.04"]),
        ({"integrator": "rk4"}, ValueError, ["`integrator`='rk4' acts nowhere", "leave"]),
        ({"masss": 1.0}, TypeError, ["unexpected keyword argument 'masss'"]),
    ],
)
def test_refusals_are_those_of_every_world(changed, error, fragments):
    arguments = {**PARTS, **changed}
    makers = (
        lambda: gym.make_vec("IntegPendulum-v0", num_envs=2, **arguments),
        lambda: functional.make("IntegPendulum-v0", **arguments),
        lambda: environment_mixture("IntegPendulum-v0", arguments),
    )
    for make in makers:
        with pytest.raises(error) as caught:
            make()
        for fragment in fragments:
            assert fragment in str(caught.value)


def test_lanes_that_cannot_be_shared_out_are_refused():
    env = functional.make("IntegPendulum-v0", **PARTS)
    with pytest.raises(ValueError, match=r"rk4 1/2, explicit_euler 1/2.*multiple of 2"):
        env.initial(jax.random.key(0), lanes=(7,))
    with pytest.raises(ValueError, match=r"give lanes=\(n,\)"):
        env.initial(jax.random.key(0))


@pytest.mark.parametrize("given", [[0, 1], [0, 1, 3], [0, -1, 0], [0.0, 1.0, 0.0], "rk4"])
def test_members_that_are_none_are_refused(given):
    vector = vector_of("IntegPendulum-v0", 3, **PARTS)
    with pytest.raises(ValueError, match="whole numbers from 0 to 2, shape"):
        vector.reset(seed=0, options={"mixture_index": given})
    single = gym.make_vec("IntegPendulum-v0", num_envs=3)
    with pytest.raises(ValueError, match="unknown reset option 'mixture_index'"):
        single.reset(seed=0, options={"mixture_index": [0, 0, 0]})
