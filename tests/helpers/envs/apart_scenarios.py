"""What is asked of processes in environments of their own, where they are and where replayed.

``python tests/helpers/envs/apart_scenarios.py`` runs the real ones, writes the recordings anew and
prints what was found; names of scenarios limit it to those.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from exchanges import record

from integ_gym.envs.testbeds import make_checked, testbed_of


def task(env_id: str, integrator: str) -> dict[str, Any]:
    """A task at home, and with another integrator at half the step: what it says and does.

    Two lanes take the same actions twice over, from the same seeds.
    """
    testbed = testbed_of(env_id, {})
    home = testbed.home
    found: dict[str, Any] = {"home": home.arguments()}
    other = replace(home, integrator=integrator, dt=home.dt / 2)
    for name, asked in (("stock", home), ("other", other)):
        environments = make_checked(testbed, asked, 2)
        found[name] = testbed.applied(environments)
        found[f"{name} episodes"] = [_steps(environments, 5) for _ in range(2)]
        environments.close()
    return found


def _steps(environments: Any, count: int) -> list[list[Any]]:
    """Observations, rewards and ends of some steps from a seed, under a constant action."""
    told = [[environments.reset(seed=3)[0].tolist()]]
    action = np.full(environments.action_space.shape, 0.25, np.float32)
    for _ in range(count):
        observed, reward, terminated, *_ = environments.step(action)
        told.append([observed.tolist(), reward.tolist(), terminated.tolist()])
    return told


SCENARIOS: dict[str, Callable[[], dict[str, Any]]] = {
    "dm_control_task": partial(task, "dm_control:cartpole.swingup", "Euler"),
}

if __name__ == "__main__":
    for name in sys.argv[1:] or SCENARIOS:
        print(name)
        for what, value in record(name, SCENARIOS[name]).items():
            print(f"  {what}: {value}")
