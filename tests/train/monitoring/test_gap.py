"""The gap between discretizations, measured and logged during somebody else's training."""

from __future__ import annotations

import numpy as np
import pytest
from stable_baselines3 import PPO
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.logger import KVWriter, Logger
from stable_baselines3.common.vec_env import VecNormalize

from integ_gym.train import DiscretizationCallback, discretization_gap

PUMPED = {"integrator": "explicit_euler", "dt": 0.05}
SHORT = {"duration": 1.0, "start": "hanging"}


def still(observation):
    assert observation.shape == (3,)
    return np.zeros(1)


def test_returns_of_all_cells_and_the_gap_to_the_lowest():
    scores = discretization_gap(
        still, "IntegPendulum-v0", PUMPED, others=["integrator=rk4,dt=0.05", PUMPED],
        episodes=2, environment=SHORT,
    )  # fmt: skip
    home, other = (scores[f"discretization/return/{name}"] for name in ("home", "rk4-dt-0.05"))
    assert scores["discretization/return_gap"] == home - other
    assert set(scores) == {
        *(f"discretization/{what}/{name}" for what in ("return", "success")
          for name in ("home", "rk4-dt-0.05")),
        "discretization/return_gap", "discretization/success_gap",
    }  # fmt: skip


def test_by_default_the_truth_and_all_integrators():
    scores = discretization_gap(still, "IntegPendulum-v0", "stock", episodes=1, environment=SHORT)
    assert "discretization/return/reference-dt-0.05" in scores
    assert sum("return/" in name for name in scores) == 7


@pytest.mark.parametrize("home", [None, {"control_period": 0.1}])
def test_a_gap_needs_a_home(home):
    with pytest.raises(ValueError, match="give home="):
        discretization_gap(still, "IntegPendulum-v0", home)


class _Kept(KVWriter):
    def __init__(self):
        self.rows = []

    def write(self, key_values, key_excluded, step=0):
        self.rows.append((step, dict(key_values)))

    def close(self):
        pass


def _learned(env, callback):
    model = PPO("MlpPolicy", env, n_steps=32, batch_size=32, n_epochs=1, seed=0, device="cpu")
    kept = _Kept()
    model.set_logger(Logger(None, [kept]))
    model.learn(128, callback=callback)
    return [(step, row) for step, row in kept.rows if "discretization/return_gap" in row]


def test_the_callback_reads_home_from_the_training_environment_and_logs():
    given = {**SHORT, **PUMPED}
    env = VecNormalize(make_vec_env("IntegPendulum-v0", 2, env_kwargs=given))
    callback = DiscretizationCallback(64, others=["integrator=rk4,dt=0.05"], episodes=2)
    logged = _learned(env, callback)
    assert [step for step, _ in logged] == [64, 128]
    assert set(logged[0][1]) >= {"discretization/return/home", "discretization/return/rk4-dt-0.05"}


def test_a_stock_environment_must_be_told_its_home():
    with pytest.raises(ValueError, match="home='stock'"):
        _learned("Pendulum-v1", DiscretizationCallback(64))
    told = DiscretizationCallback(
        64, env_id="IntegPendulum-v0", home="stock", others=["integrator=rk4,dt=0.05"], episodes=1
    )
    assert len(_learned("Pendulum-v1", told)) == 2


def test_nothing_is_evaluated_in_less_than_a_step():
    with pytest.raises(ValueError, match="1 or above"):
        DiscretizationCallback(0)
