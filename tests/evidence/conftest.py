"""Runs of recorded environments that several tests look at."""

import shutil

import pyarrow.parquet as pq
import pytest
from recording import PENDULUM, made, play, recorded

from integ_gym.evidence.labels import EpisodeContext
from integ_gym.evidence.store import EvidenceStore


@pytest.fixture(scope="session")
def two_environments(tmp_path_factory):
    """A run's directory with three pendulum and three cart-pole records."""
    run = tmp_path_factory.mktemp("run")
    settings = {"integrator": "rk4", "dt": 0.05, "control_period": 0.05, "duration": 10.0}
    for env_id, cell in ((PENDULUM, "rk4 at 0.05 s"), ("IntegCartPole-v0", "balance")):
        context = EpisodeContext("run", cell, policy_id="random")
        recorded(run / "evidence", range(3), context, env_id, **settings)
    return run


@pytest.fixture(scope="session")
def batch(tmp_path_factory):
    """A file of three short pendulum records."""
    env = made(tmp_path_factory.mktemp("batch"))
    play(env, range(3))
    path = env.commit("batch")
    env.close()
    return path


@pytest.fixture(scope="session")
def table(batch):
    """What stands in that file."""
    return pq.read_table(batch)


@pytest.fixture
def store(tmp_path, batch):
    """A store with that file alone."""
    shutil.copy(batch, tmp_path)
    return EvidenceStore(tmp_path)
