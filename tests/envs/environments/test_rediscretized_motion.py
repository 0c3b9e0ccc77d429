"""Rediscretized tasks: the periods that the ledger leaves open, and divergences."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from engine_cases import needs

import integ_gym

INTEGRATORS = ("Euler", "implicit", "implicitfast", "discrete", "RK4")


@pytest.fixture(autouse=True)
def _mujoco(tmp_path, monkeypatch):
    needs("mujoco")
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def undamped(tmp_path) -> str:
    """The inverted pendulum's model without damping: each of its losses is known."""
    from gymnasium.envs import mujoco

    source = Path(mujoco.__file__).parent / "assets" / "inverted_pendulum.xml"
    text = source.read_text(encoding="utf-8")
    assert 'damping="1"' in text
    path = tmp_path / "undamped.xml"
    path.write_text(text.replace('damping="1"', 'damping="0"'), encoding="utf-8")
    return str(path)


def _from(env, q, v, control):
    """What is told of one control period from a state of one's own."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(env.unwrapped, "reset_model", lambda: _placed(env.unwrapped, q, v))
        env.reset(seed=0)
    return env.step(np.full(env.action_space.shape, control, np.float32))[4]


def _placed(task, q, v):
    task.set_state(np.array(q), np.array(v))
    return task._get_obs()


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_a_period_in_which_a_limit_acted_is_open_and_every_other_closes(integrator, undamped):
    """Starts at random near the end of the track, at a step of the whole control period.

    A stage of a Runge-Kutta step may be beyond it where the last one is not.
    """
    stock = gym.make("InvertedPendulum-v5", xml_file=undamped)
    env = integ_gym.rediscretize(stock, integrator=integrator, dt=0.04)
    free = integ_gym.rediscretize(
        gym.make("InvertedPendulum-v5", xml_file=undamped), integrator=integrator, dt=0.04
    )
    free.unwrapped.model.jnt_limited[:] = 0
    rng, opened = np.random.default_rng(0), 0
    for _ in range(240):
        x = rng.choice([-1.0, 1.0]) * rng.uniform(0.8, 1.05)
        q, v = (x, rng.uniform(-1.5, 1.5)), rng.uniform(-4.0, 4.0, 2)
        control = rng.uniform(-3.0, 3.0)
        told, known = _from(env, q, v, control), _from(free, q, v, control)
        acted = bool((env.state != free.state).any())
        if acted:
            assert "energy_residual" not in told
        elif "energy_residual" in told:
            assert told["energy_residual"] == known["energy_residual"]
        opened += "energy_residual" not in told
    assert 30 < opened < 150


def test_a_divergence_ends_the_episode_where_mujoco_would_start_it_anew():
    env = integ_gym.rediscretize(gym.make("InvertedPendulum-v5"))
    env.reset(seed=0)
    last, earned, *_ = env.step(np.zeros(1, np.float32))
    env.unwrapped.data.qvel[:] = 1e7
    observation, reward, terminated, _, info = env.step(np.zeros(1, np.float32))
    assert terminated
    assert info["solver_status"] == "diverged"
    assert (observation == last).all()
    assert earned == 1.0
    assert reward == -earned
    assert not info["success"]


def test_a_divergence_pays_the_least_reward_for_all_that_was_left():
    env = integ_gym.rediscretize(gym.make("HalfCheetah-v5"))
    env.reset(seed=0)
    rewards = [env.step(env.action_space.high)[1] for _ in range(20)]
    env.unwrapped.data.qvel[:] = 1e7
    assert min(rewards) < 0.0
    expected = min(rewards) * (1000 - 20) - max(0.0, sum(rewards))
    assert env.step(env.action_space.high)[1] == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(
    ("task", "integrator", "known"),
    [("Swimmer-v5", "RK4", False), ("InvertedPendulum-v5", "RK4", False),
     ("InvertedPendulum-v5", "Euler", True)],
)  # fmt: skip
def test_what_a_diverged_period_lost_is_unknown_where_losses_are(task, integrator, known):
    """Where they are known, the period is taken back and nothing is booked."""
    env = integ_gym.rediscretize(gym.make(task), integrator=integrator)
    env.reset(seed=0)
    env.unwrapped.data.qvel[:] = 1e7
    info = env.step(np.zeros(env.action_space.shape, np.float32))[4]
    assert info["solver_status"] == "diverged"
    assert env.setup.engine.describe()["losses_accounted"] is known
    for name in ("energy_residual", "dissipated"):
        assert info.get(name) == (0.0 if known else None)


EXPLOSION = """
import gymnasium, integ_gym, numpy
for task, speed in (("Hopper-v5", 1e8), ("Ant-v5", 9e5)):
    for integrator in {integrators!r}:
        env = integ_gym.rediscretize(gymnasium.make(task), integrator=integrator)
        for seed in range(2):
            env.reset(seed=seed)
            env.unwrapped.data.qvel[:] = speed
            info = env.step(numpy.zeros(env.action_space.shape, numpy.float32))[4]
            assert info["solver_status"] == "diverged", info
"""


def test_a_divergence_is_told_and_not_written_about(tmp_path):
    """Nothing on the terminal and no MUJOCO_LOG.TXT in the user's folder."""
    script = EXPLOSION.format(integrators=INTEGRATORS)
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=False, cwd=tmp_path
    )
    assert (done.returncode, done.stdout + done.stderr) == (0, "")
    assert not list(tmp_path.iterdir())
