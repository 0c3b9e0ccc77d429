"""All installed engines in one process."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import replace

import gymnasium as gym
import pytest
from engine_cases import COMPILING, FIRST, IDS, lighter, needs
from engine_checks import told_by_an_episode

import integ_gym
from integ_gym.envs.engines.simulator import load_undisturbed
from integ_gym.envs.engines.stepping import missing_modules
from integ_gym.envs.numerics.stepping import engine_of
from integ_gym.envs.plants.pendulum import Pendulum
from integ_gym.envs.plants.system import PlantSystem
from integ_gym.envs.settings import Discretization
from integ_gym.envs.testbeds.making import find_testbed
from integ_gym.support import optional as versions

SCRIPT = """
import math, warnings
import gymnasium as gym
import integ_gym

warnings.simplefilter("error")
cases, ids = {cases!r}, {ids!r}
envs = [
    gym.make(env_id, engine=engine, integrator=integrator, dt=0.02)
    for engine, integrator in cases
    for env_id in ids
]
for env in envs:
    env.reset(seed=0)
for _ in range(5):
    for env in envs:
        told = env.step(env.action_space.sample())
        assert math.isfinite(told[1]) and told[4]["solver_status"] != "diverged"
assert {{env.unwrapped.setup.settings.engine for env in envs}} == {{engine for engine, _ in cases}}
"""


@pytest.mark.parametrize(
    "cases",
    [pytest.param(FIRST, marks=pytest.mark.slow), [x for x in FIRST if x[0] not in COMPILING]],
    ids=["all", "light"],
)
def test_every_engine_steps_both_plants_in_one_process(cases, tmp_path):
    """Built one after another, then stepped in turn: silently, and to the end.

    Engines that compile nothing; all of them in `make test-slow`.
    """
    installed = [case for case in cases if not missing_modules(case[0])]
    if not installed:
        pytest.skip("no engine but the native one is installed")
    script = SCRIPT.format(cases=installed, ids=IDS)
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=False, cwd=tmp_path
    )
    assert (done.returncode, done.stdout + done.stderr) == (0, "")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("engine", "integrator", "steps"),
    lighter([
        ("mujoco", "Euler", 20), ("mujoco", "RK4", 1), ("pybullet", "semi_implicit_euler", 1),
        ("sapien", "tgs", 1), ("mujoco_warp", "Euler", 1), ("newton", "mujoco_euler", 1),
    ]),
)  # fmt: skip
def test_of_a_divergence_nothing_is_printed_and_nothing_written(
    engine, integrator, steps, tmp_path
):
    needs(engine)
    assert told_by_an_episode(engine, integrator, tmp_path, steps) == (0, "")


NOISY = """
import os, warnings
os.write(2, b"banner of version 1\\nsomething else\\n")
os.environ["NOISY"] = "1"
os.environ["KEPT"] = "2"
warnings.warn("look out")
"""


def test_an_import_writes_nothing_and_leaves_the_environment_as_it_was(
    tmp_path, monkeypatch, capfd
):
    (tmp_path / "noisy_simulator.py").write_text(NOISY)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("KEPT", "1")
    before = dict(os.environ)
    assert load_undisturbed("noisy_simulator", "mujoco") is sys.modules.pop("noisy_simulator")
    assert dict(os.environ) == before
    with pytest.raises(ModuleNotFoundError, match=r'pip install -e "\.\[mujoco\]"'):
        load_undisturbed("no_such_simulator", "mujoco")
    assert capfd.readouterr() == ("", "")
    os.write(2, b"banner\n")
    assert capfd.readouterr().err == "banner\n"


PACKAGES = {"mjx": "mujoco-mjx", "mujoco_warp": "mujoco-warp", "dart": "dartpy", "pinocchio": "pin"}
"""Of engines whose package has another name."""


@pytest.fixture
def aged(monkeypatch):
    """Makes an installed package report version 0.9."""

    def age(package):
        found = versions.package_version
        monkeypatch.setattr(
            versions, "package_version", lambda name: "0.9" if name == package else found(name)
        )

    return age


@pytest.mark.parametrize(("engine", "integrator"), FIRST)
def test_an_engine_of_an_older_version_is_refused_in_one_sentence(engine, integrator, aged):
    needs(engine)
    package = PACKAGES.get(engine, engine)
    least = versions.required_by_extra(engine)[package]
    aged(package)
    told = rf'{package} 0.9 is installed, .*\[{engine}\] needs {least} .*; run: pip install "'
    asked = Discretization(integrator, 0.05, 0.05, engine)
    with pytest.raises(ValueError, match=told):
        gym.make("IntegPendulum-v0", **asked.arguments())
    with pytest.raises(ValueError, match=told):
        gym.make_vec("IntegPendulum-v0", 2, "vector_entry_point", **asked.arguments())
    with pytest.raises(ValueError, match=told):
        engine_of(f"{engine}/{integrator}", PlantSystem(Pendulum()), 0.05)


def test_a_task_of_mujoco_is_checked_too(aged, monkeypatch):
    needs("mujoco")
    stock = gym.make("InvertedPendulum-v5")
    testbed = find_testbed("InvertedPendulum-v5", {"reset_noise_scale": 0.02})
    aged("mujoco")
    told = 'mujoco 0.9 is installed, and .*; run: pip install "mujoco>='
    with pytest.raises(ValueError, match=told):
        integ_gym.rediscretize(stock)
    with pytest.raises(ValueError, match=told):
        _ = testbed.home
    monkeypatch.setenv(versions.ANY_VERSION, "other,mujoco")
    assert replace(testbed.home, dt=0.01).dt == 0.01
