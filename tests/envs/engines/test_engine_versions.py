"""An engine whose package is older than its extra asks for is refused where it is made."""

from __future__ import annotations

from dataclasses import replace

import gymnasium as gym
import pytest
from engine_cases import FIRST, needs

import integ_gym
from integ_gym.envs.numerics.stepping import engine_of
from integ_gym.envs.plants.pendulum import Pendulum
from integ_gym.envs.plants.system import PlantSystem
from integ_gym.envs.settings import Discretization
from integ_gym.envs.testbeds.making import find_testbed
from integ_gym.support import optional as versions

PACKAGES = {"mjx": "mujoco-mjx", "mujoco_warp": "mujoco-warp", "dart": "dartpy", "pinocchio": "pin"}
"""Of engines whose package has another name."""


@pytest.fixture
def aged(monkeypatch):
    """Makes an installed package report version 0.9."""

    def age(package):
        found = versions.package_version
        monkeypatch.setattr(
            versions, "package_version", lambda name: "0.9" if name == package else found(name)
        )

    return age


@pytest.mark.parametrize(("engine", "integrator"), FIRST)
def test_an_engine_of_an_older_version_is_refused_in_one_sentence(engine, integrator, aged):
    needs(engine)
    package = PACKAGES.get(engine, engine)
    least = versions.required_by_extra(engine)[package]
    aged(package)
    told = rf'{package} 0.9 is installed, .*\[{engine}\] needs {least} .*; run: pip install "'
    asked = Discretization(integrator, 0.05, 0.05, engine)
    with pytest.raises(ValueError, match=told):
        gym.make("IntegPendulum-v0", **asked.arguments())
    with pytest.raises(ValueError, match=told):
        gym.make_vec("IntegPendulum-v0", 2, "vector_entry_point", **asked.arguments())
    with pytest.raises(ValueError, match=told):
        engine_of(f"{engine}/{integrator}", PlantSystem(Pendulum()), 0.05)


def test_a_task_of_mujoco_is_checked_too(aged, monkeypatch):
    needs("mujoco")
    stock = gym.make("InvertedPendulum-v5")
    testbed = find_testbed("InvertedPendulum-v5", {"reset_noise_scale": 0.02})
    aged("mujoco")
    told = 'mujoco 0.9 is installed, and .*; run: pip install "mujoco>='
    with pytest.raises(ValueError, match=told):
        integ_gym.rediscretize(stock)
    with pytest.raises(ValueError, match=told):
        _ = testbed.home
    monkeypatch.setenv(versions.ANY_VERSION, "other,mujoco")
    assert replace(testbed.home, dt=0.01).dt == 0.01
