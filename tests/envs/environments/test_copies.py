"""Environments that are copied or pickled go on as the original does."""

import copy
import pickle

import gymnasium as gym
import numpy as np
import pytest
from engine_cases import FIRST, lighter
from pairing import pairs
from sameness import assert_same

from integ_gym import along
from integ_gym.envs.integrators.interface import Step
from integ_gym.envs.rediscretized import rediscretize
from integ_gym.envs.registries import ENVIRONMENTS
from integ_gym.envs.steps import WARM_UP

STEPS = 3 * WARM_UP
WAYS = {"copied": copy.deepcopy, "pickled": lambda env: pickle.loads(pickle.dumps(env))}


class Iterating:
    """Says that every step took three iterations, and makes lanes fall so that many are reset."""

    def step(self, ops, system, q, v, losses, control, dt):
        rates, powers = system.rates(ops, q, v, control)
        return Step(along(q, dt, v), along(v, dt, rates), along(losses, dt, powers), 3)


def _rollout(env, actions):
    """What every step tells; a single environment begins anew when it ends."""
    told = []
    for action in actions:
        *results, info = env.step(action)
        told.append((results, info))
        if not np.ndim(results[2]) and (results[2] or results[3]):
            told.append(env.reset())
    return told


def _goes_on_alike(env, before, steps, copied):
    env.reset(seed=1)
    env.action_space.seed(1)
    actions = [env.action_space.sample() for _ in range(steps)]
    _rollout(env, actions[:before])
    other = copied(env)
    assert_same(_rollout(other, actions), _rollout(env, actions))


@pytest.mark.parametrize(
    ("env_id", "kind", "before", "way"),
    [
        *pairs(ENVIRONMENTS, ("single", "vector"), (1, WARM_UP + 1), WAYS),
        ("IntegPendulum-v0", "compiled", WARM_UP + 1, "pickled"),
    ],
)
def test_a_copy_goes_on_alike(env_id, kind, before, way):
    given = {"hold_probability": 0.2} if way == "pickled" else {}
    if kind == "single":
        env = gym.make(env_id, **given)
    else:
        env = gym.make_vec(env_id, num_envs=3, compiled=kind == "compiled", **given)
    _goes_on_alike(env, before, STEPS, WAYS[way])


@pytest.mark.parametrize("way", WAYS)
def test_what_all_lanes_have_in_common_stays_theirs(way):
    """The iterations of a step that are the same in all lanes, where some have just been reset."""
    integrator = f"{__name__}:Iterating"
    env = gym.make_vec("IntegCartPole-v0", 3, integrator=integrator)
    _goes_on_alike(env, WARM_UP + 1, STEPS, WAYS[way])


@pytest.mark.parametrize(
    ("engine", "integrator", "way"),
    lighter([(*case, way) for case, way in pairs(FIRST, WAYS, strength=1)]),
)
def test_simulators_are_made_anew(engine, integrator, way):
    env = gym.make("IntegPendulum-v0", engine=engine, integrator=integrator)
    _goes_on_alike(env, 2, 5, WAYS[way])


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("make", [gym.make, gym.make_vec])
def test_a_mixture_of_control_periods_goes_on(make, way):
    members = [{"dt": 0.05, "control_period": period} for period in (0.05, 0.1)]
    _goes_on_alike(
        make("IntegPendulum-v0", mixture=members, duration=2.0), STEPS // 3 + 5, STEPS, WAYS[way]
    )


@pytest.mark.parametrize("way", [*WAYS.values(), copy.copy])
def test_a_rediscretized_task_is_not_copied(way):
    env = rediscretize(gym.make("InvertedPendulum-v5"), dt=0.01)
    with pytest.raises(TypeError, match="make another one and set its state"):
        way(env)
