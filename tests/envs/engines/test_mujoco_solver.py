"""MuJoCo's solver settings as arguments of its tasks."""

from __future__ import annotations

import gymnasium as gym
import mujoco
import numpy as np
import pytest

import integ_gym
from integ_gym.envs.engines.mujoco_solver import SETTINGS, read_solver, write_solver

OTHERS = {
    "iterations": 3, "ls_iterations": 7, "noslip_iterations": 2, "tolerance": 1e-4,
    "ls_tolerance": 0.1, "noslip_tolerance": 1e-3, "impratio": 10.0, "solver": "CG",
    "cone": "elliptic", "jacobian": "dense", "eulerdamp": False, "refsafe": False,
    "warmstart": False,
}  # fmt: skip


def test_what_is_written_is_read_back():
    model = mujoco.MjModel.from_xml_string("<mujoco/>")
    own = read_solver(mujoco, model)
    assert set(own) == set(SETTINGS) == set(OTHERS)
    for name, value in OTHERS.items():
        assert own[name] != value
        write_solver(mujoco, model, {name: value})
        assert read_solver(mujoco, model) == {**own, name: value}
        write_solver(mujoco, model, {name: own[name]})
    assert read_solver(mujoco, model) == own


@pytest.mark.parametrize(
    ("settings", "about"),
    [
        ({"iteration": 1}, "iterations"),
        ({"iterations": 1.5}, "whole"),
        ({"tolerance": -1.0}, "at least 0"),
        ({"impratio": True}, "at least 0"),
        ({"cone": "round"}, "elliptic"),
        ({"refsafe": 1}, "true or false"),
    ],
)
def test_a_wrong_setting_is_refused(settings, about):
    with pytest.raises(ValueError, match=about):
        integ_gym.rediscretize(gym.make("Hopper-v5"), solver=settings)


def test_a_task_is_solved_and_recorded_with_its_settings():
    stock = gym.make("Hopper-v5")
    model = stock.unwrapped.model
    model.opt.iterations, model.opt.cone = 1, 1
    env = integ_gym.rediscretize(
        gym.make("Hopper-v5"), solver={"iterations": 1, "cone": "elliptic"}
    )
    plain = integ_gym.rediscretize(gym.make("Hopper-v5"))
    ends = []
    for one in (stock, env, plain):
        one.reset(seed=1)
        for _ in range(20):
            seen, *_ = one.step(np.full(3, 0.3, np.float32))
        ends.append(seen)
    assert (ends[0] == ends[1]).all()
    assert (ends[1] != ends[2]).any()
    solver = env.setup.arguments()["solver"]
    assert (solver["iterations"], solver["cone"], solver["solver"]) == (1, "elliptic", "Newton")
    assert env.setup.engine.solver()["solver_cap"] == 1
