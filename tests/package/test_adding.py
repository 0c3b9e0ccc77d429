"""docs/how-to/adding.md: its files work together as they stand on the page."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from importlib import import_module
from pathlib import Path
from shutil import copytree, ignore_patterns

import pytest
from house import FLOORS, ROOT, page_blocks, page_text

from integ_gym.cli import main
from integ_gym.envs.numerics.stepping import advance
from integ_gym.eval.diagnosis import run

PAGE = "docs/how-to/adding.md"
LINES = {
    "PLANTS": '"slider": "integ_gym.envs.plants.slider:Slider",',
    "INTEGRATORS": '"ralston": "integ_gym.envs.integrators.ralston:Ralston",',
    "TASKS": '"settle": "integ_gym.envs.tasks.settle:Settle",',
    "ENVIRONMENTS": '"IntegSettle-v0": "integ_gym.envs.catalogue.settle:IntegSettle",',
    "DEFAULT_DECISIONS": '"IntegSettle-v0": 500,',
}
USE = """
import gymnasium as gym
import integ_gym
from integ_gym import numerics
from integ_gym.envs.registries import PLANTS

env = gym.make("IntegSettle-v0", integrator="ralston", dt=0.01, control_period=0.02)
env.reset(seed=0)
print(env.spec.max_episode_steps, env.step([0.0])[4]["energy_residual"] != 0.0)
print(gym.make_vec("IntegSettle-v0", num_envs=3).reset(seed=0)[0].shape)
print(round(numerics.classify("ralston", PLANTS.load("slider")()).order, 1), integ_gym.__file__)
"""


def test_task_plant_and_integrator_of_the_page_run(tmp_path, monkeypatch, capsys):
    """A task in a process of its own; what the integrator is, by three sections."""
    for block in page_blocks(PAGE, "python"):
        (name,) = re.findall(r"\A# (\w+\.py)$", block, re.MULTILINE)
        (tmp_path / name).write_text(block, encoding="utf-8")
    command = [sys.executable, "-W", "error", "use_task.py"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert re.search(r"x = -?\d\.\d{3} m", done.stdout)
    assert "(8, 2)" in done.stdout
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    bouncer = import_module("my_bouncer").Bouncer()
    _, speed = advance("rk4", bouncer, (0.001, -1.0), 1e-4, 400)
    assert speed == pytest.approx(0.75, abs=0.01)
    sections = ("plant", "integrator", "stiffness")
    monkeypatch.setattr(run, "SECTIONS", {name: run.SECTIONS[name] for name in sections})
    words = shlex.split(page_blocks(PAGE, "sh")[0])[1:]
    assert main([*words, "--all", "--no-progress", "--workers", "1"]) == 0
    printed = capsys.readouterr().out
    rows = {" ".join(row.split()) for row in printed.splitlines()}
    told = next(block for block in page_blocks(PAGE, "text") if not block.startswith("integ-gym"))
    assert {" ".join(row.split()) for row in told.splitlines()} <= rows
    assert "my_plant:Slider, plant: rate of energy" in printed


def test_parts_of_ones_own_need_the_users_door_alone():
    code = "\n".join(page_blocks(PAGE, "python"))
    imported = re.findall(r"^(?:from|import) (integ_gym\S*)", code, re.MULTILINE)
    assert set(imported) == {"integ_gym"}


def test_parts_of_the_page_become_parts_of_the_tree(tmp_path):
    """In a copy: by the files of the page's table and lines in the registries, and no others."""
    package = tmp_path / "integ_gym"
    for floor in FLOORS:
        place = package if floor == "package" else package / floor
        copytree(ROOT / floor, place, ignore=ignore_patterns("__pycache__"), dirs_exist_ok=True)
    blocks = {
        name: block
        for block in page_blocks(PAGE, "python")
        for name in re.findall(r"\A# (\w+)\.py$", block, re.MULTILINE)
    }
    task, environments = blocks["my_task"].split("class SettleEnv")
    environments, _ = f"class SettleEnv{environments}".split("gym.register")
    head = task[: task.index("@dataclass")]
    files = {
        "envs/plants/slider.py": blocks["my_plant"],
        "envs/integrators/ralston.py": blocks["my_integrator"],
        "envs/tasks/settle.py": task.replace("my_plant:Slider", "slider"),
        "envs/catalogue/settle.py": head
        + re.sub(r"\b(Settle\w*Env)\b", r"Integ\1", environments).replace(
            "my_task:Settle", "settle"
        ),
    }
    page = page_text(PAGE)
    for path, code in files.items():
        assert f"| `{path}`" in page or f", `{path}`" in page, f"{PAGE} does not list {path}"
        (package / path).write_text(code, encoding="utf-8")
    registries = package / "envs" / "registries.py"
    text = registries.read_text(encoding="utf-8")
    for registry, line in LINES.items():
        opening = rf"(^{registry}: Final = (?:Registry\([^{{]*)?{{)"
        text, count = re.subn(opening, rf"\1\n{line}", text, flags=re.MULTILINE)
        assert count == 1, f"envs/registries.py has no {registry}"
    registries.write_text(text, encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "-c", USE], cwd=tmp_path, capture_output=True, text=True, check=False,
        env={**os.environ, "PYTHONPATH": str(tmp_path)},
    )  # fmt: skip
    assert done.returncode == 0, f"the files and lines of {PAGE} are not enough: {done.stderr}"
    steps, shape, order, place = re.fullmatch(
        r"(\d+ True)\n(.*)\n(\S+) (.*)\n", done.stdout
    ).groups()
    assert (steps, shape, order) == ("500 True", "(3, 2)", "2.0")
    assert Path(place).is_relative_to(package)
