"""Imports run one way, and importing changes nothing outside the package."""

from __future__ import annotations

import ast
import json
import subprocess
import sys
from pathlib import Path

import pytest

import integ_gym

ROOT = Path(integ_gym.__file__).parent.parent
LAYERS = ("envs", "evidence", "train", "eval", "package")
SOURCES = sorted(
    path
    for layer in LAYERS
    for path in (ROOT / layer).rglob("*.py")
    if "__pycache__" not in str(path)
)


def _imported(path: Path) -> set[str]:
    modules = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            modules |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            modules.add(node.module or "")
    return modules


def _layer(module: str) -> int | None:
    parts = module.split(".")
    if parts[0] != "integ_gym":
        return None
    return (
        LAYERS.index(parts[1]) if len(parts) > 1 and parts[1] in LAYERS else LAYERS.index("package")
    )


@pytest.mark.parametrize("path", SOURCES, ids=lambda p: str(p.relative_to(ROOT)))
def test_imports_run_one_way(path):
    own = LAYERS.index(path.relative_to(ROOT).parts[0])
    for module in _imported(path):
        layer = _layer(module)
        assert layer is None or layer <= own, f"{path} imports {module}"


@pytest.mark.parametrize("path", sorted((ROOT / "envs").rglob("*.py")), ids=lambda p: p.name)
def test_layers_inside_envs(path):
    """A plant knows no integrator, an integrator no plant, an engine no task."""
    folder = path.relative_to(ROOT / "envs").parts[0]
    forbidden = {
        "plants": ("integrators", "engines", "tasks", "environment"),
        "integrators": ("plants", "engines", "tasks", "environment"),
        "maps": ("plants", "engines", "tasks", "environment"),
        "engines": ("tasks", "environment"),
        "tasks": ("integrators", "engines", "environment"),
    }.get(folder, ())
    for module in _imported(path):
        for name in forbidden:
            assert not module.startswith(f"integ_gym.envs.{name}"), f"{path} imports {module}"


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
import integ_gym.envs.jax_ops
import integ_gym.eval.panel
from integ_gym.cli import main
from integ_gym.train.ppo import PPOConfig, train_ppo
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
    done = subprocess.run([sys.executable, "-c", WORK], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout.splitlines()[-1])
    assert result["jax"]
    assert set(result["environ"]) <= set(SET_BY_TORCH)
