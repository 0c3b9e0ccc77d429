"""The gap between discretizations, measured and logged during somebody else's training."""

import sys
from types import SimpleNamespace

import gymnasium as gym
import numpy as np
import pytest
from stable_baselines3 import PPO
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.logger import KVWriter, Logger
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

from integ_gym.train import sb3_callback
from integ_gym.train.monitoring import discretization_gap, send_to_trackers
from integ_gym.train.sb3_callback import DiscretizationCallback

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
    with pytest.raises(ValueError, match="`episodes` must be 1 or above"):
        discretization_gap(still, "IntegPendulum-v0", "stock", episodes=0)


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


def _learned(env, callback, on=False):
    """Steps at which a gap was logged, with the rows; also of a training that goes on."""
    model = PPO("MlpPolicy", env, n_steps=32, batch_size=32, n_epochs=1, seed=0, device="cpu")
    kept = _Kept()
    model.set_logger(Logger(None, [kept]))
    model.learn(128, callback=callback)
    if on:
        model.learn(128, callback=callback, reset_num_timesteps=False)
        model.learn(64, callback=callback)
    return [(step, row) for step, row in kept.rows if "discretization/return_gap" in row]


def test_the_callback_reads_home_from_the_training_environment_and_logs():
    given = {**SHORT, **PUMPED}
    env = VecNormalize(make_vec_env("IntegPendulum-v0", 2, env_kwargs=given))
    callback = DiscretizationCallback(64, others=["integrator=rk4,dt=0.05"], episodes=2)
    logged = _learned(env, callback, on=True)
    assert [step for step, _ in logged] == [64, 128, 192, 256, 64]
    assert set(logged[0][1]) >= {"discretization/return/home", "discretization/return/rk4-dt-0.05"}


def test_open_runs_of_trackers_get_the_numbers(monkeypatch):
    sent, entered = [], []
    wandb = SimpleNamespace(run=None, log=sent.append)
    mlflow = SimpleNamespace(
        active_run=lambda: None, log_metrics=lambda scores, step: entered.append((step, scores))
    )
    monkeypatch.setitem(sys.modules, "wandb", wandb)
    monkeypatch.setitem(sys.modules, "mlflow", mlflow)
    send_to_trackers({"gap": 1.0}, 64)
    assert not sent
    assert not entered
    wandb.run, mlflow.active_run = object(), object
    env = make_vec_env("IntegPendulum-v0", 1, env_kwargs={**SHORT, **PUMPED})
    callback = DiscretizationCallback(64, others=["integrator=rk4,dt=0.05"], episodes=1)
    logged = _learned(env, callback)
    assert [step for step, _ in entered] == [step for step, _ in logged]
    for (step, scores), row, (_, kept) in zip(entered, sent, logged, strict=True):
        assert row == {**scores, "global_step": step}
        assert scores.items() <= kept.items()


def test_a_stock_environment_must_be_told_its_home():
    with pytest.raises(ValueError, match="home='stock'"):
        _learned("Pendulum-v1", DiscretizationCallback(64))
    told = DiscretizationCallback(
        64, env_id="IntegPendulum-v0", home="stock", others=["integrator=rk4,dt=0.05"], episodes=1
    )
    assert len(_learned("Pendulum-v1", told)) == 2
    with pytest.raises(ValueError, match="1 or above"):
        DiscretizationCallback(0)


@pytest.mark.parametrize(
    ("told", "message"),
    [
        ({"others": ["rk4"]}, "'rk4' cannot be read; give integrator="),
        ({"others": ["integrator=rk9,dt=0.05"]}, "unknown integrator 'rk9'"),
        ({"others": ["integrator=rk4,dt=0.03"]}, "not a whole multiple"),
        ({"environment": {"masss": 1.0}}, "masss"),
        ({"others": ["control_period=0.05"]}, "`others` names discretizations"),
        ({"environment": {"dt": 0.01}}, "gives `dt`, which is what differs"),
    ],
)
def test_what_cannot_be_made_is_refused_before_the_training(told, message):
    """And not after the first so many steps of it."""
    model = PPO("MlpPolicy", "Pendulum-v1", n_steps=8, batch_size=8, device="cpu")
    callback = DiscretizationCallback(10**6, env_id="IntegPendulum-v0", home="stock", **told)
    with pytest.raises((TypeError, ValueError), match=message):
        model.learn(8, callback=callback)


STEPS = [{"dt": 0.025}, {"dt": 0.05}]


@pytest.mark.parametrize("given", [STEPS, [{"mixture": STEPS}]])
def test_several_discretizations_are_no_home(given):
    made = [lambda own=own: gym.make("IntegPendulum-v0", control_period=0.05, **own)
            for own in given]  # fmt: skip
    with pytest.raises(ValueError, match=r"\(symplectic_euler dt=0\.025, symplectic"):
        _learned(DummyVecEnv(made), DiscretizationCallback(64))


def test_a_stated_home_takes_the_other_arguments_from_the_training(monkeypatch):
    env = make_vec_env("IntegPendulum-v0", n_envs=1, env_kwargs={**SHORT, "max_torque": 1.0})
    seen = []

    def looked(*_, environment, **__):
        seen.append(environment)
        return {}

    monkeypatch.setattr(sb3_callback, "discretization_gap", looked)
    _learned(env, DiscretizationCallback(32, env_id="IntegPendulum-v0", home="stock"))
    assert seen[0]["max_torque"] == 1.0
    assert "dt" not in seen[0]
