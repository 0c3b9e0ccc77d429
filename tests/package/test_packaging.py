"""The wheel holds the package, and runs with the core dependencies alone."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest

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
    source, out = tmp_path_factory.mktemp("source") / "tree", tmp_path_factory.mktemp("wheel")
    ignored = shutil.ignore_patterns(".*", "runs", "build", "*.egg-info", "__pycache__")
    shutil.copytree(ROOT, source, ignore=ignored)
    command = [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", str(out)]
    said = subprocess.run([*command, str(source)], check=True, capture_output=True, text=True)
    assert "is absent from the `packages` configuration" not in said.stdout + said.stderr
    (built,) = out.glob("*.whl")
    return built


def _configuration() -> dict:
    return tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


@pytest.mark.slow
def test_wheel_holds_every_module(wheel):
    folders = _configuration()["tool"]["setuptools"]["package-dir"]
    expected = set()
    for package, folder in folders.items():
        for path in (ROOT / folder).rglob("*"):
            if path.suffix in {".py", ".typed", ".toml", ".j2", ".json", ".css", ".js"}:
                inside = path.relative_to(ROOT / folder)
                expected.add(f"{package.replace('.', '/')}/{inside.as_posix()}")
    names = set(zipfile.ZipFile(wheel).namelist())
    assert expected <= names, sorted(expected - names)


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


def test_no_folder_shadows_the_package():
    assert not (ROOT / "integ_gym").exists()
