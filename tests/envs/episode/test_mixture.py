"""Mixtures: what is drawn, with which shares, and that all worlds advance the same."""

import gymnasium as gym
import jax
import numpy as np
import pytest
from functional_checks import compare, programs_serving, vector_of
from motions import ALL
from pairing import in_turn
from variants import SOFT

from integ_gym.envs import functional
from integ_gym.envs.environment import environment_mixture
from integ_gym.envs.registries import ENVIRONMENTS

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
PERIODS = [
    {"integrator": "rk4", "dt": 0.04, "control_period": 0.04, "weight": 3},
    {"integrator": "rk4", "dt": 0.02, "control_period": 0.08},
    {"integrator": "explicit_euler", "dt": 0.04, "control_period": 0.12, "weight": 4},
]
"""Members that decide at different control periods."""


@pytest.mark.parametrize("several", [False, True], ids=["one period", "several periods"])
def test_every_integrator_and_step_equals_the_vector_environment(several):
    """With stops."""
    arguments = {"mixture": EVERYTHING, "control_period": PERIOD}
    if several:
        periods = [{**m, "control_period": (1 + k % 2) * PERIOD} for k, m in enumerate(EVERYTHING)]
        arguments = {"mixture": periods}
    compare("IntegCartPoleSwingUp-v0", arguments, 5, 3 * len(ALL))


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


LATE = {
    "resets": {},
    "latency": {"action_latency": 0.08, "fallback": "zero"},
    "late observations": {"observation_latency": 0.08},
    "sensor": {"sensor_period": 0.12},
}


@pytest.mark.parametrize(("env_id", "late"), in_turn(ENVIRONMENTS, LATE))
def test_several_control_periods_equal_the_vector_environment(env_id, late):
    arguments = {"mixture": PERIODS, "duration": 0.24, **LATE[late], **SOFT.get(env_id, {})}
    assert compare(env_id, arguments, 14, 16) > 16


def _episode(env, rng, **options):
    """What an episode under some actions told, and the actions."""
    told, actions, over = [env.reset(options=options)], [], False
    while not over:
        actions.append(rng.uniform(env.action_space.low, env.action_space.high))
        told.append(env.step(actions[-1]))
        over = told[-1][2] or told[-1][3]
    return told, actions


@pytest.mark.parametrize(
    "arguments",
    [
        {},
        {"action_latency": 0.08, "observation_latency": 0.08},
        {"observation_noise": 0.1},
        {"latency_jitter": 0.08, "hold_probability": 0.2},
    ],
    ids=["plain", "late", "noisy", "lossy"],
)
def test_an_episode_of_a_mixture_is_one_of_the_member_alone(arguments):
    """To the last bit, before and after steps are traced: decisions, rewards, and the end."""
    arguments = {"duration": 1.2, **arguments}
    mixed = gym.make("IntegPendulum-v0", mixture=PERIODS, **arguments)
    rng, seen = np.random.default_rng(0), []
    mixed.reset(seed=3)
    for episode in range(12):
        start = rng.uniform(-1.0, 1.0, 2)
        told, actions = _episode(mixed, rng, state=start)
        member = told[0][1]["mixture_index"]
        given = {k: x for k, x in PERIODS[member].items() if k != "weight"}
        alone = gym.make("IntegPendulum-v0", **given, **arguments)
        alone.reset(seed=3)
        expected = [alone.reset(options={"state": start, "episode": episode + 1})]
        expected += [alone.step(action) for action in actions]
        for (*found, info), (*values, own) in zip(told, expected, strict=True):
            np.testing.assert_equal(found, values)
            np.testing.assert_equal(info, {**own, "mixture_index": member})
        assert expected[-1][3]
        assert len(actions) == round(1.2 / given["control_period"])
        seen.append(member)
    assert set(seen) == {0, 1, 2}


def test_a_single_environment_takes_the_member_that_it_is_given():
    env = gym.make("IntegPendulum-v0", mixture=PERIODS)
    for member, given in enumerate(PERIODS):
        _, info = env.reset(seed=0, options={"mixture_index": member})
        assert info["mixture_index"] == member
        assert env.step(env.action_space.sample())[4]["time"] == given["control_period"]
    for wrong in (3, -1, 0.0, [0], "rk4"):
        with pytest.raises(ValueError, match=r"whole numbers from 0 to 2, shape \(\)"):
            env.reset(options={"mixture_index": wrong})


def test_the_longest_members_decisions_are_the_limit():
    limits = {None: (250, [250, 125, 84]), 100: (100, [100, 100, 84]), 84: (84, [84, 84, 84])}
    for asked, (limit, counts) in limits.items():
        single = gym.make("IntegPendulum-v0", mixture=PERIODS, max_episode_steps=asked)
        lanes = gym.make_vec("IntegPendulum-v0", 3, mixture=PERIODS, max_episode_steps=asked)
        again = gym.make(single.spec), gym.make_vec(lanes.spec)
        for env in (single, lanes, *again):
            assert env.spec.max_episode_steps == limit
            horizons = [setup.timing.horizon for setup in env.unwrapped.mixture.setups]
            assert horizons == counts
        lanes.reset(seed=0, options={"mixture_index": np.arange(3)})
        ends = np.array([lanes.step(np.zeros((3, 1)))[3] for _ in range(limit)])
        assert (np.argmax(ends, axis=0) + 1).tolist() == counts
    with pytest.raises(ValueError, match="from 1 to 250"):
        gym.make("IntegPendulum-v0", mixture=PERIODS, max_episode_steps=251)


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

    def alone(changed):
        return functional.make("IntegPendulum-v0", **{**PARTS, **changed}).transition

    finer = [{**member, "dt": member["dt"] / 2} for member in WEIGHTED]
    changes = {}, {"mass": 2.0}, {"mixture": finer}, {"mass": np.linspace(1.0, 2.0, 16)}
    assert programs_serving(env, changes, alone, 16) == 1 + 1  # once more for one mass per lane
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
        ({"control_period": None}, ValueError, ["give `control_period`", "0.02, 0.04"]),
        ({"mixture": PERIODS}, ValueError, ["`control_period`=0.04 has no effect", "leave"]),
        ({"integrator": "rk4"}, ValueError, ["`integrator`='rk4' has no effect", "leave"]),
        ({"masss": 1.0}, TypeError, ["unexpected keyword argument 'masss'"]),
    ],
)
def test_refusals_are_those_of_every_world(changed, error, fragments):
    arguments = {**PARTS, **changed}
    makers = (
        lambda: gym.make("IntegPendulum-v0", **arguments),
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
