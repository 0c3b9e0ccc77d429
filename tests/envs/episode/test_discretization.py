"""The discretization as a value: one equality, one JSON form."""

from __future__ import annotations

import json
from dataclasses import replace

import gymnasium as gym

from integ_gym.envs.registries import ENVIRONMENTS
from integ_gym.envs.settings import DISCRETIZATION, Discretization, agrees

RK4 = Discretization("rk4", 0.1 + 0.2, 0.6)


def test_a_step_is_the_same_from_a_file_and_from_a_division():
    for dt in (0.3, 0.9 / 3.0):
        same = replace(RK4, dt=dt)
        assert same == RK4
        assert len({same, RK4}) == 1
    assert RK4.dt == 0.1 + 0.2
    assert Discretization(**json.loads(json.dumps(RK4.arguments()))).arguments() == RK4.arguments()
    assert tuple(RK4.arguments()) == DISCRETIZATION
    assert agrees({"integrator": "rk4", "dt": 0.3}, RK4.arguments())


def test_what_differs_is_another():
    nearly = {"dt": 0.3 * (1 + 1e-9)}
    for changes in (nearly, {"control_period": 0.3}, {"engine": "mujoco"}, {"integrator": "x"}):
        other = replace(RK4, **changes)
        assert other != RK4
        assert len({other, RK4}) == 2
        assert not agrees(other.arguments(), RK4.arguments())
    assert RK4 != "rk4"


def test_an_environment_tells_its_own():
    for env_id in ENVIRONMENTS:
        env = gym.make(env_id, integrator="rk4", dt=0.05 / 3, control_period=0.05)
        found = Discretization.of(env.unwrapped.setup)
        assert found == Discretization("rk4", 0.016666666666666666, 0.05)
