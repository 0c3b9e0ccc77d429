"""Python on the pages of ``docs`` runs: here, or in the tests of what a page is about."""

from __future__ import annotations

import os
import subprocess
import sys
import textwrap

import pytest
from house import ROOT, page_blocks

ELSEWHERE = (
    "explanation/census.md", "explanation/verification.md", "how-to/adding.md",
    "how-to/judge.md", "how-to/own_robot.md", "how-to/testbeds.md", "reference/environments.md",
    "reference/evidence.md",
)  # fmt: skip
COMPILED = {
    "how-to/check.md": "trains twelve policies; tests/eval/test_check.py trains two",
    "how-to/clusters.md": "needs an installation of MPI",
}
TRAINED = """
import integ_gym
config = integ_gym.PPOConfig.of(
    "IntegPendulum-v0", total_steps=2048, env_arguments={"integrator": "rk4", "dt": 0.05}
)
integ_gym.train_ppo([config], ["runs/rk4"], progress=False, tensorboard=False)
"""
PANEL = """
from pathlib import Path
import integ_gym
Path("small.toml").write_text('''
name = "small"
env_id = "IntegPendulum-v0"
control_period = 0.05
seeds = [0]
episodes = 2
trainer = "sb3"
training = { total_steps = 2048 }
train = [{ integrator = "rk4", dt = 0.05 }]
evaluate = [{ integrator = "rk4", dt = 0.05 }]
''')
integ_gym.run_panel("small.toml", "runs/panel", workers=1, progress=False)
"""
OWN = """
from stable_baselines3 import PPO
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.vec_env import VecNormalize
normalized = VecNormalize(make_vec_env("integ_gym:IntegPendulum-v0"))
PPO("MlpPolicy", normalized).save("policy.zip")
normalized.save("vecnormalize.pkl")
import gymnasium as gym
import torch
envs = gym.vector.SyncVectorEnv(
    [lambda: gym.wrappers.NormalizeObservation(gym.make("Pendulum-v1"))]
)
model_path = "agent.cleanrl_model"
actor = {"actor_mean.0.weight": torch.zeros(1, 3), "actor_mean.0.bias": torch.zeros(1)}
torch.save(actor, model_path)
class writer:
    add_scalar = print
global_step = 0
class agent:
    _observation_preprocessor = torch.nn.Identity()
    class policy:
        compute = staticmethod(lambda inputs, role: (2.0 * inputs["observations"], {}))
observation_size = 3
"""
HERE = {
    "how-to/films.md": (TRAINED, {}),
    "how-to/fleet.md": (
        "",
        {"seed=seed)": "seed=seed, total_steps=4096)", "range(10)": "range(2)"},
    ),
    "how-to/policies.md": (
        OWN,
        {
            "100_000": "512",
            "10_000": "1_500",
            'out="runs/mine"': 'out="runs/mine", episodes=2',
            'home="stock")\nmodel': 'home="stock", episodes=2)\nmodel',
            "discretization_gap(act": "discretization_gap(policy",
            '"stock").items()': '"stock", episodes=2).items()',
        },
    ),
    "how-to/questions.md": ("", {}),
    "how-to/versions.md": ("", {}),
    "reference/engines.md": ("", {"307_200": "2048"}),
    "reference/panel.md": (PANEL, {}),
    "tutorials/first_steps.md": ("", {}),
}
"""Page to what its blocks take for granted, and what makes them short."""


def _blocks(page: str) -> list[str]:
    return page_blocks(f"docs/{page}", "python")


def test_no_page_is_left_out():
    pages = (path.relative_to(ROOT / "docs") for path in (ROOT / "docs").rglob("*.md"))
    assert {page.as_posix() for page in pages if _blocks(str(page))} == {
        *ELSEWHERE,
        *COMPILED,
        *HERE,
    }


@pytest.mark.parametrize("page", COMPILED)
def test_what_cannot_run_here_is_python(page):
    for block in _blocks(page):
        compile(block, page, "exec")


@pytest.mark.slow
@pytest.mark.parametrize("page", HERE)
def test_blocks_run_one_after_the_other(page, tmp_path):
    before, shorter = HERE[page]
    code = "\n".join(_blocks(page))
    for long, short in shorter.items():
        assert long in code
        code = code.replace(long, short)
    body = textwrap.indent(f"{before}\n{code}", "    ")
    (tmp_path / "page.py").write_text(f'if __name__ == "__main__":\n{body}\n', encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "page.py"], cwd=tmp_path, capture_output=True, text=True, check=False,
        env={**os.environ, "PYTHONWARNINGS": "ignore", "PYTHONPATH": str(ROOT)},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    if page == "tutorials/first_steps.md":
        for said in page_blocks(f"docs/{page}", "text"):
            assert said in done.stdout
