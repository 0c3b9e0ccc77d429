"""dm_control's suite, served: run by the interpreter of its environment, apart from integ-gym."""

from __future__ import annotations

from importlib import import_module
from math import inf
from typing import Any


class Served:
    """Tasks of the suite, one environment for each lane."""

    def __init__(self) -> None:
        self._lanes: list[Any] = []
        self._lost = import_module("dm_control.rl.control").PhysicsError

    def home(self, task: str, arguments: dict[str, Any]) -> dict[str, Any]:
        """Integrator, step and control period, s, of a task as it comes."""
        env = _stock(task, arguments)
        return {
            "integrator": _integrator(env.physics),
            "dt": env.physics.timestep(),
            "control_period": env.control_timestep(),
        }

    def make(
        self,
        task: str,
        integrator: str,
        dt: float,
        control_period: float,
        arguments: dict[str, Any],
    ) -> dict[str, Any]:
        """A lane; the environment is made anew, for it counts its steps where it is made."""
        stock = _stock(task, arguments)
        options = stock.physics.model.opt
        options.integrator = _number(integrator)
        options.timestep = dt
        env = import_module("dm_control.rl.control").Environment(
            stock.physics, stock.task, time_limit=inf, control_timestep=control_period,
            flat_observation=True,
        )  # fmt: skip
        self._lanes.append(env)
        actions = env.action_spec()
        return {
            "lane": len(self._lanes) - 1,
            "observations": len(_observations(env.reset())),
            "low": actions.minimum.tolist(),
            "high": actions.maximum.tolist(),
            "decisions": round(stock._step_limit),
        }

    def applied(self, lane: int) -> dict[str, Any]:
        """What a lane does, from its compiled model and its count of steps."""
        env = self._lanes[lane]
        step, count = env.physics.model.opt.timestep, env._n_sub_steps
        return {
            "integrator": _integrator(env.physics),
            "dt": step,
            "control_period": step * count,
            "substeps": count,
        }

    def reset(self, lane: int, seed: int) -> list[float]:
        """Start an episode; its first observation."""
        env = self._lanes[lane]
        env.task.random.seed(seed)
        return _observations(env.reset())

    def step(self, lane: int, action: list[float]) -> tuple[list[float], float, bool]:
        """One decision; what is observed, the reward, and whether the task ended the episode.

        A motion that diverges ends it, without a reward: it observes nothing more.
        """
        env = self._lanes[lane]
        try:
            now = env.step(action)
        except self._lost:
            return [0.0] * len(_observations(env.reset())), 0.0, True
        return _observations(now), float(now.reward), bool(now.last())


def _stock(task: str, arguments: dict[str, Any]) -> Any:
    suite = import_module("dm_control.suite")
    domain, _, name = task.partition(".")
    if (domain, name) not in suite.ALL_TASKS:
        known = ", ".join(".".join(one) for one in suite.ALL_TASKS)
        raise ValueError(f"unknown task of dm_control {task!r}; known: {known}")
    return suite.load(domain, name, task_kwargs=arguments or None)


def _number(integrator: str) -> int:
    return int(getattr(import_module("mujoco").mjtIntegrator, f"mjINT_{integrator.upper()}"))


def _integrator(physics: Any) -> str:
    kinds = import_module("mujoco").mjtIntegrator
    known = {"EULER": "Euler", "RK4": "RK4", "IMPLICIT": "implicit", "IMPLICITFAST": "implicitfast"}
    return known[kinds(physics.model.opt.integrator).name.removeprefix("mjINT_")]


def _observations(now: Any) -> list[float]:
    observed: list[float] = now.observation["observations"].tolist()
    return observed
