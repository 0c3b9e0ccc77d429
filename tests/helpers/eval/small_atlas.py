"""An atlas that is trained in seconds, as TOML."""

from __future__ import annotations

from pathlib import Path

SMALL = """
name = "small"
env_id = "IntegPendulum-v0"
control_period = 0.05
seeds = [3, 4]
episodes = 2
ladder = false
baselines = []
perturbations = []

[atlas]
argument = "max_torque"
ratios = [1.5, 3.0]
seeds_per_block = 1

[environment]
start = "hanging"
duration = 3.0

[training]
total_steps = 512
n_envs = 4
n_steps = 32
batch_size = 64

[[train]]
integrator = "rk4"
dt = 0.05

[[train]]
integrator = "reference"
dt = 0.05

[[evaluate]]
integrator = "rk4"
dt = 0.05
"""


def written(folder: Path, **replaced: str) -> Path:
    """The atlas as a file, with some lines replaced: key to the whole line."""
    lines = [
        next((new for key, new in replaced.items() if line.startswith(f"{key} = ")), line)
        for line in SMALL.splitlines()
    ]
    path = folder / "small.toml"
    path.write_text("\n".join(lines), encoding="utf-8")
    return path
