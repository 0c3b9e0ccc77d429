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

    def names(self, lane: int) -> dict[str, list[str]]:
        """Of a lane's joints, with the dimensions of each, and of its actuators."""
        model = self._lanes[lane].physics.model
        joints = [model.id2name(k, "joint") or f"joint{k}" for k in range(model.njnt)]
        sizes = {0: (7, 6), 1: (4, 3)}  # free, ball; hinges and slides have one
        of_q, of_v = (
            [_part(name, k, size) for name, size in named for k in range(size)]
            for named in (
                [(j, sizes.get(int(model.jnt_type[k]), (1, 1))[part]) for k, j in enumerate(joints)]
                for part in (0, 1)
            )
        )
        actuators = [model.id2name(k, "actuator") or f"actuator{k}" for k in range(model.nu)]
        return {"coordinates": of_q, "velocities": of_v, "actuators": actuators}

    def state(self, lane: int) -> list[float]:
        """Positions, then velocities."""
        data = self._lanes[lane].physics.data
        return [*data.qpos.tolist(), *data.qvel.tolist()]

    def observation(self, lane: int, state: list[float]) -> list[float]:
        """What the task observes in a state."""
        env = self._lanes[lane]
        _place(env.physics, state)
        flat = import_module("dm_control.rl.control").flatten_observation
        observed: list[float] = flat(env.task.get_observation(env.physics))["observations"].tolist()
        return observed

    def command(self, lane: int, state: list[float], action: list[float]) -> list[float]:
        """The task's command to the actuators, within their limits."""
        env = self._lanes[lane]
        model, data = env.physics.model, _place(env.physics, state)
        env.task.before_step(import_module("numpy").array(action), env.physics)
        control: list[float] = data.ctrl.tolist()
        for k, (low, high) in enumerate(model.actuator_ctrlrange.tolist()):
            if model.actuator_ctrllimited[k]:
                control[k] = min(max(control[k], low), high)
        return control

    def force(self, lane: int, state: list[float], command: list[float]) -> list[float]:
        """MuJoCo's generalized force of the actuators."""
        data = _place(self._lanes[lane].physics, state, ctrl=command)
        found: list[float] = data.qfrc_actuator.tolist()
        return found

    def acceleration(self, lane: int, state: list[float], force: list[float]) -> list[float]:
        """MuJoCo's accelerations under a force, with the actuators off."""
        physics, off = self._lanes[lane].physics, import_module("mujoco").mjtDisableBit
        option = physics.model.opt
        held = option.disableflags, option.integrator
        option.disableflags = held[0] | int(off.mjDSBL_ACTUATION)
        option.integrator = _number("Euler")
        found: list[float] = _place(physics, state, qfrc_applied=force).qacc.tolist()
        option.disableflags, option.integrator = held
        return found


def _part(name: str, place: int, size: int) -> str:
    return name if size == 1 else f"{name}{place}"


def _place(physics: Any, state: list[float], **inputs: list[float]) -> Any:
    """Data of MuJoCo in a state, with nothing left of what went before."""
    mujoco, model, data = import_module("mujoco"), physics.model, physics.data
    mujoco.mj_resetData(model.ptr, data.ptr)
    data.qpos[:], data.qvel[:] = state[: model.nq], state[model.nq :]
    for name, values in inputs.items():
        getattr(data, name)[:] = values
    mujoco.mj_forward(model.ptr, data.ptr)
    return data


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
