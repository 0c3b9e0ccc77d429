"""What is asked of processes in environments of their own, where they are and where replayed.

``python tests/helpers/engines/apart_scenarios.py`` runs the real ones, writes the recordings anew
and prints what was found; names of scenarios limit it to those. It imports from
``tests/helpers/envs``, which is to be on the ``PYTHONPATH``.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from engine_cases import DAMPING, RECORDED_IDS, native_name, states
from engine_checks import defect, new_setup
from exchanges import record

from integ_gym.envs.numerics.stepping import one_step
from integ_gym.envs.registries import ENGINES
from integ_gym.envs.testbeds.making import find_testbed, make_checked
from integ_gym.eval.census.published import decision, isaaclab_plant


def isaaclab_engine() -> dict[str, float]:
    """Largest error of one step of every integrator against its map, both plants, damping or not.

    Relative to 1 + |value|, at 0.02 s.
    """
    found = {}
    for integrator in ENGINES.load("isaaclab").maps:
        for env_id in RECORDED_IDS:
            for damped in (False, True):
                setup = new_setup(
                    "isaaclab", integrator, env_id, **DAMPING[env_id] if damped else {}
                )
                cases = [*states(setup, 8), *states(setup, 4, strongest=0.0)]
                name = f"{integrator} {env_id} {'damped' if damped else 'undamped'}"
                found[name] = defect(setup, cases)
    return found


def task(env_id: str, integrator: str) -> dict[str, Any]:
    """A task at home, and with another integrator at half the step: what it says and does.

    Two lanes take the same actions twice over, from the same seeds.
    """
    testbed = find_testbed(env_id, {})
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


def isaaclab_task_steps() -> dict[str, tuple[float, float]]:
    """Errors of one step of Isaac Lab's task against symplectic Euler's two kinds or rk4.

    With the damping of its cart taken explicitly, and implicitly; relative to 1 + |value|. Of each
    integrator with the task's damping and without; of two Newton steps in one of Isaac Lab's, too.
    """
    found = {}
    for integrator in ("euler", "implicitfast", "rk4"):
        for damping in (10.0, 0.0):
            found[f"{integrator}, damping {damping:g}"] = _errors(integrator, damping, 1)
    found["euler, damping 10, two steps"] = _errors("euler", 10.0, 2)
    return found


def _errors(integrator: str, damping: float, count: int) -> tuple[float, float]:
    dt = PERIOD / count
    decided = decision(integrator, dt, cart_damping=damping, newton_substeps=count)
    known = ("rk4",) * 2 if integrator == "rk4" else ("symplectic_euler", IMPLICITLY)
    steps = [one_step(native_name(name), isaaclab_plant(damping), dt) for name in known]
    errors = [0.0, 0.0]
    rng = np.random.default_rng(1)
    for _ in range(8):
        x, tip, speed, spin = rng.uniform(-2.0, 2.0, 4).astype(np.float32).tolist()
        start, force = ((x, tip), (speed, spin)), float(rng.uniform(-100.0, 100.0))
        got = np.array(decided(*start, force)).ravel()
        for place, step in enumerate(steps):
            state = start
            for _ in range(count):
                state = step(*state, force)
            expected = np.array(state).ravel()
            error = np.abs(got - expected) / (1.0 + np.abs(expected))
            errors[place] = max(errors[place], float(error.max()))
    return errors[0], errors[1]


PERIOD = 1 / 60
IMPLICITLY = "symplectic_euler_implicit_damping"


SCENARIOS: dict[str, Callable[[], dict[str, Any]]] = {
    "dm_control_task": partial(task, "dm_control:cartpole.swingup", "Euler"),
    "isaaclab_engine": isaaclab_engine,
    "isaaclab_task": partial(task, "isaaclab:Isaac-Cartpole-Direct", "rk4"),
    "isaaclab_task_steps": isaaclab_task_steps,
}

if __name__ == "__main__":
    for name in sys.argv[1:] or SCENARIOS:
        print(name)
        for what, value in record(name, SCENARIOS[name]).items():
            print(f"  {what}: {value}")
