"""Importing needs the core alone and changes nothing outside the package."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from small_panel import TOML

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


BLOCKED = """
import sys
from importlib.machinery import PathFinder

HIDDEN = ("torch", "stable_baselines3", "tensorboard", "mujoco")


class Finder(PathFinder):
    @classmethod
    def find_spec(cls, name, path=None, target=None):
        if name.partition(".")[0] in HIDDEN:
            return None
        return super().find_spec(name, path, target)


sys.meta_path[sys.meta_path.index(PathFinder)] = Finder
"""
SPEC = TOML.replace('trainer = "sb3"', "")


@pytest.mark.slow
def test_a_panel_and_all_that_is_done_with_it_needs_no_torch(tmp_path: Path):
    (tmp_path / "blocked").mkdir()
    (tmp_path / "blocked" / "sitecustomize.py").write_text(BLOCKED)
    (tmp_path / "light.toml").write_text(SPEC)
    own = {**os.environ, "PYTHONPATH": str(tmp_path / "blocked")}

    def command(*words: str) -> str:
        line = [sys.executable, "-m", "integ_gym.cli", *words]
        done = subprocess.run(line, cwd=tmp_path, env=own, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        return done.stdout

    command("panel", "light.toml", "--out", "run", "--no-progress")
    assert "</html>" in (tmp_path / "run" / "report.html").read_text("utf-8")
    policies = tmp_path / "run" / "policies"
    for folder in policies.iterdir():
        assert {file.name for file in folder.iterdir()} == {"policy.json", "policy.safetensors"}
    panel = json.loads((tmp_path / "run" / "panel.json").read_text("utf-8"))
    file = panel["rows"][0]["policies"][0]["file"]
    assert file == "policies/explicit_euler-dt-0.05-seed0/policy.safetensors"
    assert "whole: every content hash matches" in command("evidence", "verify", "run")
    before = (tmp_path / "run" / "panel.json").read_bytes()
    command("panel", "light.toml", "--out", "run", "--no-progress")
    assert (tmp_path / "run" / "panel.json").read_bytes() == before
    command("report", "run")
    kept = str(policies / "rk4-dt-0.05-seed0" / "policy.safetensors")
    cell = ("--integrator", "rk4", "--dt", "0.05", "--episodes", "2", "--no-progress")
    command("evaluate", kept, "--env", "IntegPendulum-v0", "--out", "mine", *cell)
    refused = [sys.executable, "-m", "integ_gym.cli", "panel", "light.toml"]
    refused += ["--trainer", "sb3", "--out", "other"]
    done = subprocess.run(refused, cwd=tmp_path, env=own, capture_output=True, text=True)
    assert done.returncode == 2
    assert done.stderr.endswith('is not installed; run: pip install -e ".[train]"\n')
