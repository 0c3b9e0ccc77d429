"""With gymnasium and numpy alone, a hint names the smallest extra that helps."""

from __future__ import annotations

import json
import subprocess
import sys

COMMANDS = {
    "panel small.toml --out run": "panel",
    "check --integrator rk4 --dt 0.05": "panel",
    "atlas small.toml": "panel",
    "train --integrator rk4 --dt 0.05 --out policy": "train",
    "train --trainer fleet --integrator rk4 --dt 0.05 --out policy": "fleet",
    "train --trainer=fleet --integrator rk4 --dt 0.05 --out policy": "fleet",
    "evaluate policy.zip --env IntegPendulum-v0 --out run": "report",
    "diagnose --example drift": "report",
    "census --published gymnasium --out run": "report",
    "report run": "report",
    "judge results.csv": "report",
    "watch run 3f9a --out film.gif": "render,report",
    "share run --repo me/run": "report,hub",
    "evidence verify run": "evidence",
}
NAMES = {
    "DiscretizationCallback": "train",
    "train_ppo": "train",
    "train_sac": "train",
    "train_fleet": "fleet",
    "run_panel": "panel",
    "check": "panel",
    "evaluate": "report",
    "read_panel": "report",
    "side_by_side": "render,report",
}
SCRIPT = """
import contextlib, io, json, sys

for name in (
    "pyarrow", "duckdb", "jsonschema", "portalocker", "torch", "stable_baselines3", "safetensors",
    "tensorboard", "rich", "scipy", "threadpoolctl", "jinja2", "matplotlib", "msgspec", "jax",
    "pygame", "PIL", "imageio_ffmpeg", "huggingface_hub",
):
    sys.modules[name] = None

import integ_gym
from integ_gym.cli import main

commands, names = json.loads(sys.argv[1])
hints = {}
for words in commands:
    with contextlib.redirect_stderr(io.StringIO()) as said:
        code = main(words.split())
    hints[words] = f"{code} {said.getvalue()}"
for name in names:
    try:
        getattr(integ_gym, name)
        hints[name] = "nothing is missing"
    except ModuleNotFoundError as error:
        hints[name] = str(error)
print(json.dumps(hints))
"""


def test_a_hint_names_the_smallest_extra_that_helps(tmp_path):
    line = [sys.executable, "-c", SCRIPT, json.dumps([list(COMMANDS), list(NAMES)])]
    done = subprocess.run(line, capture_output=True, text=True, cwd=tmp_path, check=True)
    hints = json.loads(done.stdout)
    wrong = {
        use: hints[use]
        for use, extra in {**COMMANDS, **NAMES}.items()
        if f'pip install -e ".[{extra}]"' not in hints[use]
    }
    assert wrong == {}
    assert all(hints[words].startswith("2 ") for words in COMMANDS)
