"""Isaac Lab's own cart-pole, served: run by Isaac Lab's interpreter, apart from integ-gym."""

from __future__ import annotations

import tempfile
from importlib import import_module
from importlib.resources import files
from pathlib import Path
from typing import Any

TASK = "Isaac-Cartpole-Direct"
ROOM = "isaaclab_tasks.core.cartpole.cartpole_direct_env"
ASSET = "cartpole_single_pendulum.usda"
"""Isaac Lab's cart-pole, which Newton brings; Isaac Lab itself loads it from the web."""


class Served:
    """One environment of the task, into which each lane's state is put when it is stepped."""

    def __init__(self) -> None:
        self._shared: dict[str, Any] = {}
        self._lanes: list[tuple[Any, Any]] = []

    def home(self, task: str, arguments: dict[str, Any]) -> dict[str, Any]:
        """Integrator, step and control period, s, of the task as it comes, on Newton."""
        cfg = _stock(task)
        return {
            "integrator": cfg.sim.physics.default.solver_cfg.integrator,
            "dt": cfg.sim.dt / cfg.sim.physics.default.num_substeps,
            "control_period": cfg.sim.dt * cfg.decimation,
        }

    def make(self, **asked: Any) -> dict[str, Any]:
        """A lane; the first makes the environment, which the others have to share.

        Args:
            asked: task, integrator, step, control period and arguments, as :func:`_environment`
                takes them.
        """
        if not self._lanes:
            self._env, self._shared = _environment(**asked), asked
            self._robot = self._env.scene["cartpole"]
            self._solver = import_module("isaaclab_newton.physics").NewtonManager._solver
            self._start = self._env._reset_idx
            self._env._reset_idx = lambda ids: None  # by which a step would start the next episode
        if asked != self._shared:
            raise ValueError(f"this process has {self._shared}, and cannot have {asked}")
        self._lanes.append(self._state())
        cfg = self._env.cfg
        limit = cfg.scene.cartpole.actuators["cart_actuator"].joint_effort_limit / cfg.action_scale
        return {
            "lane": len(self._lanes) - 1,
            "observations": int(cfg.observation_space),
            "low": [-limit],
            "high": [limit],
            "decisions": int(self._env.max_episode_length),
        }

    def applied(self, lane: int) -> dict[str, Any]:
        """What a decision does: its steps as the solver is asked for them, and the solver's kind.

        The timestep of MuJoCo's model would tell another: it is not kept up to date.
        """
        steps, kept, real = [], self._lanes[lane], self._solver.step

        def noted(now: Any, then: Any, control: Any, contacts: Any, dt: float) -> None:
            steps.append(dt)
            real(now, then, control, contacts, dt)

        self._solver.step = noted
        try:
            self.step(lane, [0.0])
        finally:
            self._solver.step = real
            self._lanes[lane] = kept
        (step,) = set(steps)
        kinds = import_module("mujoco").mjtIntegrator
        name = kinds(int(self._solver.mjw_model.opt.integrator)).name
        return {
            "integrator": name.removeprefix("mjINT_").lower(),
            "dt": step,
            "control_period": step * len(steps),
            "substeps": len(steps),
        }

    def reset(self, lane: int, seed: int) -> list[float]:
        """Start an episode as the task draws it; its first observation."""
        torch = import_module("torch")
        torch.manual_seed(seed)
        self._start(torch.arange(1, dtype=torch.int32))
        self._lanes[lane] = self._state()
        return self._observed()

    def put(self, lane: int, position: list[float], velocity: list[float]) -> None:
        """Set a lane's state: cart, m, and pole, rad, which tips to -x where it is positive."""
        torch = import_module("torch")
        self._lanes[lane] = torch.tensor([position]), torch.tensor([velocity])

    def step(self, lane: int, action: list[float]) -> tuple[list[float], float, bool]:
        """One decision; what is observed, the reward, and whether the task ended the episode."""
        torch, (position, velocity) = import_module("torch"), self._lanes[lane]
        self._robot.write_joint_position_to_sim_index(position=position)
        self._robot.write_joint_velocity_to_sim_index(velocity=velocity)
        self._env.episode_length_buf.zero_()
        self._solver.mjw_data.qacc_warmstart.zero_()
        _, reward, terminated, *_ = self._env.step(torch.tensor([action]))
        self._lanes[lane] = self._state()
        return self._observed(), float(reward[0]), bool(terminated[0])

    def _state(self) -> tuple[Any, Any]:
        data = self._robot.data
        return data.joint_pos.torch.clone(), data.joint_vel.torch.clone()

    def _observed(self) -> list[float]:
        observed: list[float] = self._env._get_observations()["policy"][0].tolist()
        return observed


def _stock(task: str) -> Any:
    if task != TASK:
        raise ValueError(f"unknown task of Isaac Lab {task!r}; known: {TASK}")
    return import_module(f"{ROOM}_cfg").CartpoleEnvCfg()


def _environment(
    task: str, integrator: str, dt: float, control_period: float, arguments: dict[str, Any]
) -> Any:
    """The task on Newton and the CPU, with nothing from the web."""
    cfg, physics = _stock(task), import_module("isaaclab_newton.physics")
    options = dict(arguments)
    count = int(options.pop("newton_substeps", 1))
    actuator = cfg.scene.cartpole.actuators["cart_actuator"]
    actuator.damping = float(options.pop("cart_damping", actuator.damping))
    if options:
        raise ValueError(f"unknown arguments of {task}: {', '.join(options)}")
    cfg.sim.device = "cpu"
    cfg.sim.dt = dt * count
    cfg.decimation = cfg.sim.render_interval = round(control_period / cfg.sim.dt)
    stock = cfg.sim.physics.default.solver_cfg
    stock.integrator = integrator
    cfg.sim.physics = physics.NewtonCfg(num_substeps=count, use_cuda_graph=False, solver_cfg=stock)
    cfg.scene.num_envs = 1
    cfg.scene.ground = cfg.scene.light = None
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, ASSET)
        text = files("newton").joinpath("examples", "assets", ASSET).read_text(encoding="utf-8")
        path.write_text(text.replace('"cartPole"', '"cartpole"'), encoding="utf-8")
        cfg.scene.cartpole.spawn.usd_path = str(path)
        return import_module(ROOM).CartpoleEnv(cfg)
