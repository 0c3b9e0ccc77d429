"""Nothing leaves its declared bounds, and what cannot be started is refused when it is made."""

from contextlib import nullcontext
from itertools import cycle

import gymnasium as gym
import numpy as np
import pytest

from integ_gym.envs.environment import environment_setup
from integ_gym.envs.functional import start_range
from integ_gym.envs.plants.system import PlantSystem
from integ_gym.envs.registries import ENVIRONMENTS

COARSE = {"dt": 0.2, "control_period": 0.2}


@pytest.mark.parametrize(
    ("env_id", "integrator"),
    list(zip(ENVIRONMENTS, cycle(["symplectic_euler", "explicit_euler"]), strict=False)),
)
def test_every_observation_is_within_the_space(env_id, integrator):
    env = gym.make(env_id, integrator=integrator, **COARSE)
    lanes = gym.make_vec(env_id, 8, integrator=integrator, **COARSE)
    for made, count in ((env, 1), (lanes, 8)):
        observation, _ = made.reset(seed=1)
        for _ in range(60):
            if count == 1:
                observation, _, terminated, truncated, _ = made.step(made.action_space.sample())
                if terminated or truncated:
                    observation, _ = made.reset()
            else:
                observation, *_ = made.step(made.action_space.sample())
            assert made.observation_space.contains(observation)


@pytest.mark.parametrize("env_id", ENVIRONMENTS)
def test_a_speed_limit_below_the_starts_is_refused_when_it_is_made(env_id):
    setup = environment_setup(env_id, {})
    limits = PlantSystem(setup.plant, 1e-3).speed_limits
    ends = [zip(corner[1::2], limits, strict=True) for corner in start_range(setup)]
    moving = any(abs(speed) > limit for corner in ends for speed, limit in corner)
    fault = r"below the speed of starts, which is up to .*; give"
    for make in (gym.make, gym.make_vec):
        with pytest.raises(ValueError, match=fault) if moving else nullcontext():
            make(env_id, max_speed=1e-3)


HUGE = (10**400, -(10**400))
NO_NUMBERS = (None, "5", b"5", 1 + 2j, {0.5}, {0.5: 1.0}, np.datetime64(5, "s"))


@pytest.mark.parametrize("env_id", ["IntegPendulum-v0", "IntegCartPole-v0"])
def test_an_action_that_is_no_number_is_refused_and_one_that_no_float_holds_falls_back(env_id):
    env, lane, lanes = gym.make(env_id).unwrapped, gym.make_vec(env_id, 1), gym.make_vec(env_id, 2)
    for made in (env, lane, lanes):
        made.reset(seed=0)
    discrete = isinstance(env.action_space, gym.spaces.Discrete)
    for value in NO_NUMBERS if not discrete else (*NO_NUMBERS, *HUGE):
        for step, given, message in (
            (env.step, value if discrete else [value], "action must"),
            (lane.step, [value] if discrete else [[value]], "actions must|larger than"),
        ):
            with pytest.raises(ValueError, match=message) as refused:
                step(given)
            assert len(str(refused.value)) < 200
    for value in () if discrete else HUGE:
        assert env.step([value])[4]["fallback_used"]
        told = lanes.step([[value], [0.0]])[4]["fallback_used"]
        assert told.tolist() == [True, False]


@pytest.mark.parametrize("make", [gym.make, gym.make_vec])
@pytest.mark.parametrize(
    ("env_id", "options"),
    [
        ("IntegPendulum-v0", {"x_init": 1e308}),
        ("IntegPendulum-v0", {"x_init": 10**400}),
        ("IntegCartPole-v0", {"low": -1e308, "high": 1e308}),
        ("IntegCartPole-v0", {"low": 10**400}),
        ("IntegPendulum-v0", {"state": [10**400, 0]}),
        ("IntegPendulum-v0", {"state": ["a", 0]}),
        ("IntegPendulum-v0", {"state": [1, [2, 3]]}),
        ("IntegPendulum-v0", {"state": (1.0,)}),
        ("IntegPendulum-v0", {"state": (np.nan, 0.0)}),
        ("IntegPendulum-v0", {"state": (0.0, 2e3)}),
        ("IntegPendulum-v0", {"sate": (0.0, 0.0)}),
        ("IntegPendulum-v0", {"x_init": "wide"}),
        ("IntegPendulum-v0", {"y_init": -1.0}),
        ("IntegCartPole-v0", {"low": 0.1, "high": -0.1}),
        ("IntegCartPole-v0", {"low": np.nan}),
    ],
    ids=lambda x: f"{x!r:.40}",
)
def test_starts_that_cannot_be_are_refused(env_id, options, make):
    if make is gym.make_vec and "state" in options:
        options = {"state": [options["state"]]}
    names = "|".join(options)
    with pytest.raises(ValueError, match=f"reset options? .*({names})"):
        make(env_id).reset(seed=0, options=options)
