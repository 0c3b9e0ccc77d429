"""Importing needs the core alone and changes nothing outside the package."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import pytest

CORE_ONLY = """
import json, os, sys
before = dict(os.environ)
import gymnasium, integ_gym
env = gymnasium.make("IntegPendulum-v0", integrator="rk4", dt=0.05)
env.reset(seed=0)
env.step(env.action_space.sample())
heavy = ["torch", "jax", "stable_baselines3", "pyarrow", "duckdb", "matplotlib", "scipy", "pygame"]
print(json.dumps({
    "heavy": [name for name in heavy if name in sys.modules],
    "environ": before == dict(os.environ),
}))
"""


def test_import_needs_core_alone_and_leaves_the_process_as_it_was():
    done = subprocess.run(
        [sys.executable, "-c", CORE_ONLY], capture_output=True, text=True, check=True
    )
    assert json.loads(done.stdout) == {"heavy": [], "environ": True}


WORK = """
import json, os, sys, tempfile
from pathlib import Path
import jax, stable_baselines3, torch
values = {name: jax.config.values[name] for name in jax.config.values}
environ = dict(os.environ)
import gymnasium
import integ_gym.envs.ops.jax_ops
import integ_gym.eval.panel.run
from integ_gym.cli import main
from integ_gym.train.ppo import PPOConfig
from integ_gym.train.runs import train_ppo
out = Path(tempfile.mkdtemp())
config = PPOConfig.of(
    "IntegPendulum-v0", total_steps=512, n_envs=4, n_steps=128, batch_size=128, n_epochs=1
)
train_ppo([config], [out / "policy"], progress=False, tensorboard=False)
main(["evaluate", str(out / "policy" / "policy.zip"), "--env", "IntegPendulum-v0", "--out",
      str(out / "run"), "--integrator", "rk4", "--dt", "0.05", "--episodes", "2", "--no-progress"])
print(json.dumps({
    "jax": values == {name: jax.config.values[name] for name in jax.config.values},
    "environ": sorted(k for k in os.environ if os.environ[k] != environ.get(k)),
}))
"""

SET_BY_TORCH = ["TORCHINDUCTOR_CACHE_DIR"]
"""Set by torch itself when its first optimizer is made."""


@pytest.mark.slow
def test_import_train_and_evaluate_leave_the_process_as_it_was():
    inherited = {k: v for k, v in os.environ.items() if not k.startswith("KMP_")}
    done = subprocess.run(
        [sys.executable, "-c", WORK], capture_output=True, text=True, check=False, env=inherited
    )
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout.splitlines()[-1])
    assert result["jax"]
    assert set(result["environ"]) <= set(SET_BY_TORCH)
