"""docs/how-to/adding.md: its files work together as they stand on the page."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from importlib import import_module
from pathlib import Path
from shutil import copy, copytree, ignore_patterns

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
CACHES = ignore_patterns("__pycache__")
BY_REFERENCE = "docs/explanation/verification.md"
LOOPING = (
    "tests/envs/integrators/test_mutations.py",
    "tests/envs/integrators/test_integrators.py",
    "tests/envs/integrators/test_conservation.py",
    "tests/envs/integrators/test_accuracy.py",
    "tests/envs/environments/test_bounds.py",
)
NEW_PARTS = "slider or ralston or Settle or test_every or as_stated"
BY_HAND = {
    ("tests/helpers/envs/plant_checks.py", "CLOSED_FORMS"): (
        r"^CLOSED_FORMS = {",
        '"slider": lambda p, q, v: ([[p.mass]], '
        "[-(p.stiffness + p.hardening * q[0] ** 2) * q[0]], p.damping * v[0] ** 2),",
    ),
    ("tests/helpers/envs/checks.py", "LINEAR_MAPS"): (
        r"^LINEAR_MAPS = {",
        '"ralston": lambda h: np.array([[1 - h * h / 2, h], [-h, 1 - h * h / 2]]),',
    ),
    ("tests/envs/integrators/test_integrators.py", "EXPLICIT_STEPS"): (
        r"^EXPLICIT_STEPS = {",
        '"ralston": lambda q, v, h: ('
        "q + h / 4 * v + 3 * h / 4 * (v + 2 * h / 3 * 15.0 * math.sin(q)), "
        "v + h / 4 * 15.0 * math.sin(q) + 3 * h / 4 * 15.0 * math.sin(q + 2 * h / 3 * v)),",
    ),
    ("tests/envs/integrators/test_integrators.py", "STABILITY"): (
        r"^STABILITY = {",
        '"ralston": 0.0,',
    ),
    ("tests/envs/integrators/test_conservation.py", "GROWTH"): (
        r"^GROWTH = {",
        '"ralston": ("linear", 1),',
    ),
    (BY_REFERENCE, ""): (
        r"^\| start, at a control of 0\.5 .*\n\|[-|]*$",
        "| `slider`, q = (0.3), v = (0.5) | 0.02 s | 1 | 12 | 9 |",
    ),
}
"""By file and table: where an entry of a new part goes, and the entry of the page's."""
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


@pytest.fixture
def grafted(tmp_path):
    """A copy of the package, with the files of the page's table and its lines in the registries."""
    package = tmp_path / "integ_gym"
    for floor in FLOORS:
        place = package if floor == "package" else package / floor
        copytree(ROOT / floor, place, ignore=CACHES, dirs_exist_ok=True)
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
    for registry, line in LINES.items():
        opening = rf"^{registry}: Final = (?:Registry\([^{{]*)?{{"
        _insert(package / "envs" / "registries.py", opening, line)
    return package


def _insert(path, opening, line) -> None:
    """Put a line after the one opening that matches."""
    text = path.read_text(encoding="utf-8")
    text, count = re.subn(f"({opening})", rf"\1\n{line}", text, flags=re.MULTILINE)
    assert count == 1, f"{path} has {count} places {opening}"
    path.write_text(text, encoding="utf-8")


def _run(package, *words):
    """Python with the copy in place of the package."""
    return subprocess.run(
        [sys.executable, *words], cwd=package.parent, capture_output=True, text=True, check=False,
        env={**os.environ, "PYTHONPATH": str(package.parent)},
    )  # fmt: skip


def test_parts_of_the_page_become_parts_of_the_tree(grafted):
    """By the files of the page's table and lines in the registries, and no others."""
    done = _run(grafted, "-c", USE)
    assert done.returncode == 0, f"the files and lines of {PAGE} are not enough: {done.stderr}"
    steps, shape, order, place = re.fullmatch(
        r"(\d+ True)\n(.*)\n(\S+) (.*)\n", done.stdout
    ).groups()
    assert (steps, shape, order) == ("500 True", "(3, 2)", "2.0")
    assert Path(place).is_relative_to(grafted)


def test_tests_of_the_tree_meet_the_parts_and_say_what_to_add_where(grafted):
    """Those that loop over registries; then the entries that they ask for are added, and they pass.

    The page names every file in which an entry is to be written by hand.
    """
    tree = grafted.parent
    copytree(ROOT / "tests", tree / "tests", ignore=CACHES)
    copy(ROOT / "pyproject.toml", tree)
    (tree / "docs" / "explanation").mkdir(parents=True)
    copy(ROOT / BY_REFERENCE, tree / BY_REFERENCE)
    words = "-m", "pytest", "-v", "-p", "no:cacheprovider", *LOOPING, "-k", NEW_PARTS
    printed = _run(grafted, *words).stdout
    for (place, table), (opening, line) in BY_HAND.items():
        name = re.search(r"\w+", line)[0]
        asked = (
            rf"{name}\b.*\b{table}\b.* of {re.escape(place)}" if table else rf"{name}\b.*{place}"
        )
        assert re.search(asked, printed), f"no failure asks for {name} in {table} of {place}"
        assert place in page_text(PAGE), f"{PAGE} does not name {place}"
        _insert(tree / place, opening, line)
    done = _run(grafted, *words)
    assert done.returncode == 0, done.stdout
    for name in ("slider", "ralston", "IntegSettle-v0"):
        assert re.search(rf"{name}.* PASSED", done.stdout), f"no test met {name}"
