"""Mixtures on testbeds of others: every episode is its member's, and starts do not depend on it."""

from __future__ import annotations

from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
from swaying import MONOPED

import integ_gym
from integ_gym import Applied, EpisodeContext, EvidenceStore, RecordVectorEvidence
from integ_gym.envs.testbeds.gym_testbed import CLASSIC
from integ_gym.envs.testbeds.making import (
    IntegTestbed,
    find_testbed,
    make_checked,
    make_training_environments,
)

TASKS = (*CLASSIC, "InvertedPendulum-v5", MONOPED)
LANES = 4

pytestmark = pytest.mark.usefixtures("robots_found")


def _places(env_id):
    home = find_testbed(env_id, {}).home
    fine, slow = (
        replace(home, dt=home.dt / 2),
        replace(home, control_period=2 * home.control_period),
    )
    return home, fine, slow


def _mixed(env_id, places, weights=None, **arguments):
    members = [
        {**place.arguments(), "weight": weight}
        for place, weight in zip(places, weights or [1] * len(places), strict=True)
    ]
    return make_training_environments(env_id, {"mixture": members, **arguments}, LANES)


@pytest.mark.parametrize("env_id", TASKS)
def test_an_episode_is_that_of_its_member_alone_to_the_last_bit(env_id):
    places = _places(env_id)
    dt = places[0].dt
    delays = {"action_latency": dt, "latency_jitter": dt, "hold_probability": 0.3}
    mixed, testbed = _mixed(env_id, places, **delays), find_testbed(env_id, delays)
    alone = [make_checked(testbed, place, 1).unwrapped.envs[0] for place in places]
    mixed.action_space.seed(0)
    drawn = set()
    for seed in (20, None, None):
        observation, info = mixed.reset(seed=seed)
        member = info["mixture_index"].tolist()
        drawn |= set(member)
        seeds = [lane.env.np_random_seed for lane in mixed.envs]
        assert seeds == [20, 21, 22, 23] or seed is None
        assert len({*seeds, 20, 21, 22, 23}) == (4 if seed else 8)
        actions = [mixed.action_space.sample() for _ in range(12)]
        steps = [mixed.step(action) for action in actions]
        for lane, (place, own) in enumerate(zip(member, seeds, strict=True)):
            single = alone[place]
            assert np.array_equal(single.reset(seed=own)[0], observation[lane])
            for action, (seen, reward, terminated, truncated, info) in zip(
                actions, steps, strict=True
            ):
                expected, earned, *ended, told = single.step(action[lane])
                assert (reward[lane], [terminated[lane], truncated[lane]]) == (earned, ended)
                if any(ended):
                    assert np.array_equal(info["final_obs"][lane], expected)
                    break
                assert np.array_equal(seen[lane], expected)
                assert info["mixture_index"][lane] == place
                assert info["time"][lane] == told["time"]
                assert info["command_held"][lane] == told["command_held"]
    assert drawn == {0, 1, 2}


@pytest.mark.parametrize("env_id", TASKS)
def test_starts_depend_on_no_member(env_id):
    """Nor do members on the task: they are drawn as those of integ-gym's own environments."""
    home, fine, *_ = _places(env_id)
    one, other = _mixed(env_id, [home, fine]), _mixed(env_id, [fine, home, home], [3, 1, 2])
    own = gym.make_vec("IntegPendulum-v0", LANES, control_period=0.05, mixture=[
        {"integrator": "rk4", "dt": 0.05}, {"integrator": "rk4", "dt": 0.025}
    ])  # fmt: skip
    members = []
    for seed in (5, None, None, 5):
        starts, info = one.reset(seed=seed)
        assert np.array_equal(starts, other.reset(seed=seed)[0])
        members.append(info["mixture_index"].tolist())
        assert members[-1] == own.reset(seed=seed)[1]["mixture_index"].tolist()
    assert members[0] == members[3] != members[1]


def test_every_record_says_what_its_episode_ran_on(tmp_path):
    env_id = "InvertedPendulum-v5"
    places = _places(env_id)
    environments = _mixed(env_id, places, [1, 2, 3], action_latency=0.02)
    ended = []
    recorded = RecordVectorEvidence(environments, tmp_path, EpisodeContext("run", "cell"))
    recorded.action_space.seed(1)
    recorded.reset(seed=3)
    for _ in range(200):
        *_, terminated, truncated, info = recorded.step(recorded.action_space.sample())
        for lane in np.flatnonzero(terminated | truncated):
            ended.append(places[info["final_info"]["mixture_index"][lane]])
    recorded.close()
    records = sorted(EvidenceStore(tmp_path).records(), key=lambda r: r["episode_index"])
    told = [(r["engine"], r["integrator"], r["dt"], r["control_period"]) for r in records]
    assert told == [tuple(place.arguments().values()) for place in ended]
    assert {r["action_latency"] for r in records} == {0.02}
    assert len({r["rng_key"] for r in records}) == len(records) > 20


class Together(IntegTestbed):
    """A testbed whose lanes advance together."""

    def __init__(self, **arguments):
        super().__init__("IntegPendulum-v0", **arguments)


class Stacked(integ_gym.GymTestbed):
    """A cart-pole that is observed more often at a finer step."""

    home = integ_gym.Discretization("explicit_euler", 0.02, 0.02, "gymnasium")
    choices = ("explicit_euler",)

    def build(self, discretization, **arguments):
        env = gym.make("CartPole-v1")
        env.unwrapped.tau = discretization.dt
        return gym.wrappers.FrameStackObservation(env, round(0.02 / discretization.dt))

    def read(self, env):
        dt = env.unwrapped.tau
        return Applied(replace(self.home, dt=dt), round(0.02 / dt))


@pytest.mark.parametrize(
    ("env_id", "given", "message"),
    [
        (f"{__name__}:Together", {"mixture": [{"dt": 0.05}, {"dt": 0.025}]}, "advance together"),
        (
            f"{__name__}:Stacked",
            {"mixture": [{"dt": 0.02}, {"dt": 0.01}]},
            "same `observation_space`",
        ),
        ("CartPole-v1", {"mixture": [{"dt": 0.02, "mass": 1}]}, "unknown key in `mixture` 'mass'"),
        ("CartPole-v1", {"mixture": [{"dt": 0.02}], "dt": 0.01}, "`dt`=0.01 has no effect"),
        ("CartPole-v1", {"mixture": [{"dt": 0.015}]}, "not a whole multiple"),
    ],
)
def test_what_cannot_be_mixed_is_refused(env_id, given, message):
    with pytest.raises(ValueError, match=message):
        make_training_environments(env_id, given, 2)
