"""The wheel holds the package, and runs with the core dependencies alone, and makes a panel."""

import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parent.parent.parent
RUN = """
import gymnasium as gym, integ_gym
env = gym.make("IntegPendulum-v0", integrator="rk4", dt=0.05, duration=1.0)
observation, info = env.reset(seed=0)
ended = False
while not ended:
    *_, ended, info = env.step(env.action_space.sample())
assert abs(info["time"] - 1.0) < 1e-9
try:
    gym.make("IntegPendulum-v0", render_mode="rgb_array").reset()
    env = gym.make("IntegPendulum-v0", render_mode="rgb_array")
    env.reset()
    env.render()
except ModuleNotFoundError as error:
    assert 'pip install "integ-gym[render]"' in str(error)
else:
    raise AssertionError("pygame should be missing")
print("ran", integ_gym.__file__)
"""


@pytest.fixture(scope="module")
def wheel(tmp_path_factory) -> Path:
    """Built from the sdist; checked by twine, and held against the tree's modules."""
    out = tmp_path_factory.mktemp("wheel")
    command = [sys.executable, str(ROOT / ".ci" / "release.py"), "--out", str(out)]
    subprocess.run(command, check=True, capture_output=True, text=True)
    (built,) = out.glob("*.whl")
    assert len(list(out.glob("*.tar.gz"))) == 1
    return built


def _configuration() -> dict:
    return tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


@pytest.mark.slow
def test_wheel_runs_with_core_dependencies_alone(wheel, tmp_path):
    environment = tmp_path / "venv"
    subprocess.run([sys.executable, "-m", "venv", str(environment)], check=True)
    python = environment / ("Scripts" if os.name == "nt" else "bin") / "python"
    pip = [str(python), "-m", "pip"]
    pinned = ["-c", str(ROOT / "constraints.txt")]
    subprocess.run([*pip, "install", "--quiet", *pinned, str(wheel)], check=True)
    listed = subprocess.run(
        [*pip, "list", "--format=freeze"], check=True, capture_output=True, text=True
    )
    names = {line.split("==")[0].lower() for line in listed.stdout.splitlines()}
    allowed = {
        "integ-gym", "gymnasium", "numpy", "cloudpickle", "typing_extensions",
        "farama-notifications", "pip", "setuptools",
    }  # fmt: skip
    assert names <= allowed
    done = subprocess.run(
        [str(python), "-c", RUN], cwd=tmp_path, check=True, capture_output=True, text=True
    )
    assert str(environment) in done.stdout


def test_every_dependency_is_pinned():
    pinned = {
        line.split("==")[0].lower().replace("_", "-")
        for line in (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    }
    project = _configuration()
    wanted = list(project["project"]["dependencies"])
    for extra in project["project"]["optional-dependencies"].values():
        wanted += extra
    for group in project["dependency-groups"].values():
        wanted += [requirement for requirement in group if isinstance(requirement, str)]
    for requirement in wanted:
        name = requirement.split(">")[0].split("[")[0].lower()
        assert name in pinned | {"integ-gym"}, name


WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda path: path.name)
def test_actions_are_pinned_by_commit_and_may_write_nothing_unasked(path):
    workflow = yaml.safe_load(path.read_text(encoding="utf-8"))
    assert workflow["permissions"] == {"contents": "read"}
    used = re.findall(r"uses: (.+)", path.read_text(encoding="utf-8"))
    for action in used:
        assert re.fullmatch(r"[\w-]+/[\w-]+@[0-9a-f]{40} # v\d+\.\d+\.\d+", action), action
    for job in workflow["jobs"].values():
        assert job["timeout-minutes"] <= 90


def test_versions_and_names_agree():
    project = _configuration()["project"]
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    zenodo = json.loads((ROOT / ".zenodo.json").read_text(encoding="utf-8"))
    recipe = yaml.safe_load((ROOT / ".ci/conda-forge/recipe.yaml").read_text(encoding="utf-8"))
    assert cited["version"] == project["version"]
    assert zenodo["title"] == cited["title"]
    assert zenodo["keywords"] == cited["keywords"]
    assert zenodo["license"] == cited["license"] == recipe["about"]["license"] == project["license"]
    asked = {line.replace(" ", "") for line in recipe["requirements"]["run"]}
    assert asked == {*project["dependencies"], f"python{project['requires-python']}"}
    done = subprocess.run(
        [sys.executable, str(ROOT / ".ci" / "release.py"), "--tag", "v0"],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 1
    assert project["version"] in done.stderr


PANEL, TRAIN, REST = '".[panel,render]"', '".[panel,render,train]"', '".[all]" --group dev'


@pytest.fixture
def clone(tmp_path: Path) -> Path:
    for name in ("Makefile", "pyproject.toml", "constraints.txt"):
        shutil.copy(ROOT / name, tmp_path)
    (tmp_path / ".venv").mkdir()
    return tmp_path


def _installed(clone: Path, target: str) -> list[str]:
    """What a target would install."""
    done = subprocess.run(
        ["make", "--dry-run", target], cwd=clone, check=True, capture_output=True, text=True
    )
    return re.findall(r"--editable (.*)", done.stdout)


def test_each_target_installs_what_it_needs(clone):
    assert _installed(clone, "panel") == [PANEL]
    assert _installed(clone, "train") == [PANEL, TRAIN]
    assert _installed(clone, "test") == [PANEL, TRAIN, REST]
