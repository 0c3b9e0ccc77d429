"""What the tests of single engines measure."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
from engine_cases import mapped, one_step

from integ_gym.envs.engines.maps import one_step_map
from integ_gym.envs.environment import environment_setup
from integ_gym.envs.settings import Setup


def new_setup(engine: str, integrator: str, env_id: str, **arguments: Any) -> Setup:
    """A setup whose engine is new, at dt = 0.02 s where nothing else is said."""
    given = {"engine": engine, "integrator": integrator, "dt": 0.02, **arguments}
    return environment_setup(env_id, given)


def defect(setup: Setup, cases: list[tuple[Any, Any, float]]) -> float:
    """Largest error of one step against the engine's map, relative to 1 + |value|."""
    known = one_step_map(setup.engine.map)
    expected = np.array([mapped(known, setup, *case) for case in cases])
    got = np.array([one_step(setup, *case) for case in cases])
    return float((np.abs(got - expected) / (1.0 + np.abs(expected))).max())


_EPISODE = """
import os
before = dict(os.environ)
import gymnasium, integ_gym, numpy, warnings
warnings.simplefilter("error")
env = gymnasium.make(
    "IntegPendulum-v0", engine={engine!r}, integrator={integrator!r}, max_torque=1e6, length=0.01,
    dt=0.05, control_period={steps} * 0.05
)
env.reset(seed=0)
diverged = False
for torque in [0.0] * 60 + [1e6]:
    diverged = diverged or env.step(numpy.full(1, torque, numpy.float32))[2]
assert diverged
assert before == dict(os.environ)
"""


def told_by_an_episode(
    engine: str, integrator: str, folder: Path, steps: int = 1
) -> tuple[int, str]:
    """Exit code and all that a process prints in which an episode runs until it diverges.

    A control period has so many ``steps``. Environment variables stay as they were and no file is
    left in ``folder``, the current one.
    """
    script = _EPISODE.format(engine=engine, integrator=integrator, steps=steps)
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=False, cwd=folder
    )
    assert not list(folder.iterdir())
    return done.returncode, done.stdout + done.stderr
