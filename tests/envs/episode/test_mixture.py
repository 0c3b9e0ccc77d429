"""Mixtures: what is drawn, with which shares, and that all worlds advance the same."""

from __future__ import annotations

import gymnasium as gym
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
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


def _vector(env_id, lanes, mixture, **arguments):
    return gym.make_vec(
        env_id,
        num_envs=lanes,
        vectorization_mode="vector_entry_point",
        autoreset_mode=AutoresetMode.DISABLED.value,
        mixture=mixture,
        control_period=PERIOD,
        **arguments,
    ).unwrapped


def _actions(space, rng, lanes):
    if isinstance(space, gym.spaces.Discrete):
        return rng.integers(space.n, size=lanes)
    return rng.uniform(1.2 * space.low, 1.2 * space.high, (lanes, 1)).astype(np.float32)


def _reset_as_drawn(vector, state, mask):
    """Begin in the vector environment what the functional one has drawn, in some lanes."""
    components = zip(state.env.q, state.env.v, strict=True)
    starts = np.stack([np.asarray(x) for pair in components for x in pair], axis=1)
    drawn = np.asarray(state.member[0])
    options = {"state": starts, "mixture_index": drawn, "reset_mask": mask}
    _, info = vector.reset(seed=0, options=options)
    np.testing.assert_array_equal(info["mixture_index"][mask], drawn[mask])


def _compare(env_id, mixture, lanes, steps, **arguments):
    """Step both under the same draws, starts and actions, in float64; counts the resets."""
    env = functional.make(
        env_id, dtype="float64", mixture=mixture, control_period=PERIOD, **arguments
    )
    vector = _vector(env_id, lanes, mixture, **arguments)
    transition, initial = (
        jax.jit(env.transition),
        jax.jit(lambda key: env.initial(key, None, (lanes,))),
    )
    rng, resets = np.random.default_rng(0), 0
    state = initial(jax.random.key(0))
    _reset_as_drawn(vector, state, np.ones(lanes, dtype=bool))
    for step in range(steps):
        action = _actions(vector.single_action_space, rng, lanes)
        observation, reward, terminated, truncated, info = vector.step(action)
        state = transition(state, action, jax.random.key(step), env.default_params)
        _assert_same(state, vector._state, info)
        np.testing.assert_allclose(env.observation(state), observation, rtol=1e-6, atol=1e-6)
        np.testing.assert_allclose(state.outcome.reward, reward, rtol=1e-12, atol=1e-12)
        np.testing.assert_array_equal(state.outcome.terminated, terminated)
        np.testing.assert_array_equal(state.outcome.truncated, truncated)
        done = terminated | truncated
        if done.any():
            begun = initial(jax.random.key(1000 + step))
            state = jax.tree.map(lambda a, b, d=done: jnp.where(d, a, b), begun, state)
            _reset_as_drawn(vector, state, done)
            resets += int(done.sum())
    return resets


def _assert_same(state, expected, info):
    for name in expected._fields:
        values = jax.tree.leaves(getattr(expected, name))
        for a, b in zip(jax.tree.leaves(getattr(state.env, name)), values, strict=True):
            np.testing.assert_allclose(
                np.asarray(a, float), np.asarray(b, float), rtol=1e-12, atol=1e-12, err_msg=name
            )
    told = {
        "energy_residual": state.outcome.residual_energy,
        "mixture_index": state.member[0],
    }
    for name, values in told.items():
        np.testing.assert_allclose(values, info[name], rtol=1e-12, atol=1e-12, err_msg=name)


def test_every_integrator_and_step_equals_the_vector_environment():
    """With stops."""
    with jax.enable_x64(True):
        _compare("IntegCartPoleSwingUp-v0", EVERYTHING, 3 * len(ALL), steps=5)


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
    with jax.enable_x64(True):
        assert _compare("IntegPendulum-v0", WEIGHTED, 16, steps=16, **arguments) == 48


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


PARTS = {"mixture": WEIGHTED, "control_period": PERIOD}


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
    vector = _vector("IntegPendulum-v0", 3, WEIGHTED)
    with pytest.raises(ValueError, match="whole numbers from 0 to 2, shape"):
        vector.reset(seed=0, options={"mixture_index": given})
    single = gym.make_vec("IntegPendulum-v0", num_envs=3)
    with pytest.raises(ValueError, match="unknown reset option 'mixture_index'"):
        single.reset(seed=0, options={"mixture_index": [0, 0, 0]})
