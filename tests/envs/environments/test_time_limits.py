"""The limit in decisions: in specs, from Gymnasium's `max_episode_steps`, in every form."""

from functools import partial

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.wrappers import TimeLimit

import integ_gym
from integ_gym.evidence.labels import EpisodeContext
from integ_gym.evidence.recorder import RecordEvidence
from integ_gym.train.vec_env import Sb3VecEnv

IDS = tuple(integ_gym.ENVIRONMENTS)
OWN_ID = "OwnLimit-v0"
PENDULUM = "integ_gym.envs.catalogue.pendulum:IntegPendulum"
SHORT = {"control_period": 0.1, "duration": 2.05, "dt": 0.05}
"""Of 21 decisions."""


@pytest.fixture
def own_id():
    gym.register(
        OWN_ID, f"{PENDULUM}Env", vector_entry_point=f"{PENDULUM}VectorEnv", max_episode_steps=30
    )
    yield OWN_ID
    del gym.registry[OWN_ID]


def _decisions(env) -> int:
    env.reset(seed=0)
    for count in range(1, 1000):
        *_, terminated, truncated, _ = env.step(env.action_space.sample())
        if np.any(truncated):
            return count
        if np.any(terminated):
            env.reset()
    raise AssertionError("never truncated")


@pytest.mark.parametrize("env_id", IDS)
def test_specs_say_after_how_many_decisions_an_episode_ends(env_id):
    single, many = gym.make(env_id, **SHORT), gym.make_vec(env_id, 2, **SHORT)
    for env in (single, single.unwrapped, many):
        assert env.spec.max_episode_steps == 21
    again = gym.make(EnvSpec.from_json(single.spec.to_json()))
    assert again.spec == single.spec == single.spec.make().spec
    assert gym.make(single.spec, max_episode_steps=5).spec.max_episode_steps == 5
    assert gym.make_vec(many.spec).spec == many.spec
    default = type(single.unwrapped)().setup.timing.horizon
    assert gym.make(env_id).spec.max_episode_steps == gym.spec(env_id).max_episode_steps == default


@pytest.mark.parametrize("make", [gym.make, gym.make_vec])
def test_an_episode_may_have_no_limit(make, tmp_path):
    env = make("IntegPendulum-v0", max_episode_steps=-1)
    assert env.spec.max_episode_steps is None
    assert (
        make(env.spec).unwrapped.setup.timing.horizon == env.unwrapped.setup.timing.horizon == 10**8
    )
    env.reset(seed=0)
    ends = [env.step(env.action_space.sample())[2:4] for _ in range(300)]
    assert not np.any(ends)
    if make is gym.make:
        with pytest.raises(ValueError, match="without a limit have no records"):
            RecordEvidence(env, tmp_path, EpisodeContext(run_id="r", cell="c"))


def test_a_shorter_limit_is_a_shorter_duration():
    asked = {"max_episode_steps": 50, "integrator": "rk4"}
    single = gym.make("IntegPendulum-v0", **asked)
    many = gym.make_vec("IntegPendulum-v0", 2, **asked)
    lanes = gym.make_vec("IntegPendulum-v0", 2, "sync", **asked)
    mixed = gym.make_vec(
        "IntegPendulum-v0", 2, mixture=[{"integrator": "rk4"}], max_episode_steps=50
    )
    adapted = gym.make_vec("IntegPendulum-v0", 2, autoreset_mode="SameStep", **asked)
    for env in (single, many, lanes, mixed):
        assert _decisions(env) == 50
    for env in (single, many, mixed):
        assert env.unwrapped.setup.settings.duration == 2.5
    adapted = Sb3VecEnv(adapted)
    adapted.reset()
    ends = [adapted.step(np.zeros((2, 1), dtype=np.float32))[2].all() for _ in range(50)]
    assert ends == [False] * 49 + [True]
    assert adapted.get_attr("spec")[0].max_episode_steps == 50


@pytest.mark.parametrize("asked", [201, 1000, 0, -2])
@pytest.mark.parametrize("make", [gym.make, gym.make_vec])
def test_a_longer_limit_is_refused_with_the_remedy(make, asked):
    with pytest.raises(ValueError, match=r"from 1 to 200, .* give a longer `duration`") as caught:
        make("IntegPendulum-v0", max_episode_steps=asked)
    assert f"got {asked}" in str(caught.value)
    longer = make("IntegPendulum-v0", duration=50.0, max_episode_steps=1000)
    assert longer.spec.max_episode_steps == 1000


def test_a_registration_of_ones_own_has_its_limit(own_id):
    assert _decisions(gym.make(own_id)) == 30
    assert _decisions(gym.make_vec(own_id, 2)) == 30
    assert gym.make_vec(own_id, 2).spec.max_episode_steps == 30
    assert gym.make(own_id, max_episode_steps=40).unwrapped.setup.timing.horizon == 40
    with pytest.raises(ValueError, match="give a longer `duration`"):
        gym.make(own_id, duration=1.0)


def test_a_recorder_refuses_a_limit_of_a_wrapper(tmp_path):
    env = TimeLimit(gym.make("IntegPendulum-v0"), 50)
    with pytest.raises(TypeError, match=r"after 50 steps, .* 200; give `max_episode_steps`"):
        RecordEvidence(env, tmp_path, EpisodeContext(run_id="r", cell="c"))


MAKES = {
    "single": gym.make,
    "lanes": partial(gym.make_vec, num_envs=2),
    "sync": partial(gym.make_vec, num_envs=2, vectorization_mode="sync"),
}
FROM_SPECS = [("single", "single"), ("single", "lanes"), ("single", "sync"), ("lanes", "lanes")]
"""The environment that has the spec, and the one that is made from it."""


def _horizon(env) -> int:
    """Of the environment, which its spec and any `TimeLimit` around it must have too."""
    single = env.envs[0] if hasattr(env, "envs") else env
    horizon = single.unwrapped.setup.timing.horizon
    assert env.spec.max_episode_steps == single.spec.max_episode_steps == horizon
    while isinstance(single, gym.Wrapper):
        assert getattr(single, "_max_episode_steps", horizon) == horizon
        single = single.env
    return horizon


@pytest.mark.parametrize(("first", "then"), FROM_SPECS)
def test_the_horizon_in_a_spec_is_no_limit_that_was_asked_for(first, then):
    """Of a spec as it is with the defaults, and of one from a file with an own control period."""
    for own, saved in (({}, False), ({"control_period": 0.2}, True)):
        _check_horizons(first, then, own, saved)


def _check_horizons(first, then, own, saved):
    spec = MAKES[first]("IntegPendulum-v0", **own).spec
    before = spec.to_json()
    given = EnvSpec.from_json(before) if saved else spec
    for change in ({"dt": 0.1}, {"duration": 20.0}, {"control_period": 0.4}, {}):
        made = MAKES[then](given, **change)
        horizon = _horizon(gym.make("IntegPendulum-v0", **{**own, **change}))
        assert _horizon(made) == horizon
        assert _horizon(MAKES[then](made.spec)) == horizon
        assert spec.to_json() == before
    assert _decisions(MAKES[then](given, duration=20.0)) == (100 if own else 400)
    assert _decisions(MAKES[then](given, dt=0.025, max_episode_steps=30)) == 30


@pytest.mark.parametrize(("first", "then"), FROM_SPECS)
def test_a_limit_that_was_asked_for_stays_in_the_spec(own_id, first, then):
    specs = (
        (MAKES[first]("IntegPendulum-v0", max_episode_steps=50).spec, 50),
        (MAKES[first](own_id).spec, 30),
        (gym.spec(own_id), 30),
    )
    for spec, limit in specs:
        for change in ({"dt": 0.025}, {"duration": 20.0}, {}):
            assert _horizon(MAKES[then](spec, **change)) == limit
    gym.registry[own_id].max_episode_steps = 200  # as many as the defaults have
    for spec in (own_id, MAKES[first](own_id).spec):
        assert _horizon(MAKES[then](spec, dt=0.025)) == 200
