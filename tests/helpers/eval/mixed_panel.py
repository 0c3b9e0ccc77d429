"""A panel with a mixture, small enough for tests."""

from __future__ import annotations

TOML = """
name = "mixed"
env_id = "IntegPendulum-v0"
control_period = 0.05
seeds = [0, 1]
episodes = 3
baselines = ["handmade"]
family = [["both", "reference dt=0.05"]]
compare = [["both", "explicit_euler dt=0.05"]]

[environment]
start = "hanging"
max_torque = 1.0
duration = 2.0

[training]
total_steps = 1024
n_steps = 32

[[train]]
integrator = "explicit_euler"
dt = 0.05

[[train]]
mixture = "both"
members = [
  { integrator = "explicit_euler", dt = 0.05, weight = 2 },
  { integrator = "rk4", dt = [0.05, 0.025] },
]

[[evaluate]]
integrator = ["explicit_euler", "rk4"]
dt = [0.05, 0.025, 0.0125]

[[perturbations]]
name = "mass +20 %"
environment = { mass = 1.2 }
"""
