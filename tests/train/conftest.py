"""Files of policies that several tests read."""

import pytest
from small_ppo import SMALL, trained


@pytest.fixture(scope="session")
def pendulum_zip(tmp_path_factory):
    """Zip of an untrained default policy on Pendulum-v1: observations (3,), actions [-2, 2]."""
    sb3 = pytest.importorskip("stable_baselines3")
    path = tmp_path_factory.mktemp("template") / "pendulum.zip"
    sb3.PPO("MlpPolicy", "Pendulum-v1", device="cpu", seed=1).save(path)
    return path


@pytest.fixture(scope="session")
def scratch(tmp_path_factory):
    return tmp_path_factory.mktemp("scratch")


@pytest.fixture(scope="session")
def small(tmp_path_factory):
    """A policy after a short run."""
    return trained(SMALL, tmp_path_factory.mktemp("small"), tensorboard=True)
