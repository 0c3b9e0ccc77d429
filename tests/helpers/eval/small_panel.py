"""A panel small enough for tests: real training, real evaluation, a few seconds."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from integ_gym.support import figures as style

TOML = """
name = "small"
env_id = "IntegPendulum-v0"
control_period = 0.05
seeds = [0, 1]
episodes = 3
trainer = "sb3"
baselines = ["random", "zero", "handmade"]
family = [["rk4 dt=0.05", "reference dt=0.05"]]
compare = [["rk4 dt=0.05", "explicit_euler dt=0.05"]]

[environment]
start = "hanging"
max_torque = 1.0
duration = 3.0

[training]
total_steps = 2048
n_steps = 64

[[train]]
integrator = ["explicit_euler", "rk4"]
dt = 0.05

[[evaluate]]
integrator = ["explicit_euler", "rk4"]
dt = [0.05, 0.0125]

[[perturbations]]
name = "mass +20 %"
environment = { mass = 1.2 }

[[perturbations]]
name = "latency 50 ms"
environment = { action_latency = 0.05 }
"""


TINY = """
name = "tiny"
env_id = "IntegPendulum-v0"
control_period = 0.05
seeds = [0, 1]
episodes = 3
trainer = "sb3"
baselines = ["random"]
family = [["explicit_euler dt=0.05", "reference dt=0.05"]]
ladder = false

[environment]
start = "hanging"
max_torque = 1.0
duration = 2.0

[training]
total_steps = 256
n_envs = 4
n_steps = 32
batch_size = 64
n_epochs = 1
net_arch = [8]

[[train]]
integrator = "explicit_euler"
dt = 0.05

[[evaluate]]
integrator = "explicit_euler"
dt = 0.05

[[perturbations]]
name = "mass +20 %"
environment = { mass = 1.2 }
"""
"""As few rows and cells as a panel can have that is judged: to run, verify and report often."""


def small_data(**changes: Any) -> dict[str, Any]:
    """The panel's specification as plain data, with changes."""
    return {**tomllib.loads(TOML), **changes}


ALONE = ("--workers", "1", "--no-progress")
"""In this process: a second takes longer to begin than it saves."""

SHORTEST = {"total_steps": 256, "n_envs": 4, "n_steps": 32, "batch_size": 64, "n_epochs": 1}
"""Hyperparameters of a training that is soon over."""


def bare_data(place: dict[str, Any], *others: dict[str, Any], **changes: Any) -> dict[str, Any]:
    """One row, evaluated at home and at other entries, and nothing beside it."""
    rows = {"train": [place], "evaluate": [place, *others], "family": [], "compare": []}
    bare = {
        "seeds": [0],
        "episodes": 2,
        "baselines": ["zero"],
        "perturbations": [],
        "ladder": False,
    }
    return small_data(**{**rows, **bare, **changes})


FORMATS = dict(style.FORMATS)


@contextmanager
def pictures_alone() -> Iterator[None]:
    """Figures are written as PNG alone, where they are not what is looked at.

    Half of what figures take is their PDF files, and a fourth their SVG files.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(style, "FORMATS", {".png": FORMATS[".png"]})
        yield


@contextmanager
def every_format() -> Iterator[None]:
    """Figures are written in every format, within `pictures_alone` too."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(style, "FORMATS", FORMATS)
        yield
