"""Isaac Lab's scene of a plant, served: run by Isaac Lab's interpreter, apart from integ-gym."""

from __future__ import annotations

import tempfile
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from typing import Any

PACKAGES = ("isaaclab", "newton", "warp-lang", "mujoco-warp")
"""What does the physics."""

ROWS = 2
"""Constraints to make room for: without any, MuJoCo Warp leaves the forces out of a step."""

UNLIMITED = 1e30
"""Largest joint effort that is applied, N or N m."""


class Served:
    """One scene of equal articulations without shapes, one for each lane."""

    def make(
        self,
        usd: str,
        gravity: float,
        joints: list[str],
        integrator: str,
        dt: float,
        lanes: int,
    ) -> dict[str, str]:
        """Make the scene in place of any that was there before; versions of what moves it.

        Args:
            usd: the articulation, text.
            gravity: m/s^2, downwards.
            joints: names of the coordinates, in order; each joint's name ends in ``_joint``.
            integrator: of Newton's MuJoCo solver, or ``featherstone``.
            dt: step, s.
            lanes: how many articulations.
        """
        sims, scenes = import_module("isaaclab.sim"), import_module("isaaclab.scene")
        sims.SimulationContext.clear_instance()
        self._dt = dt
        self._sim = sims.SimulationContext(
            sims.SimulationCfg(
                dt=dt, device="cpu", gravity=(0.0, 0.0, -gravity), physics=_physics(integrator)
            )
        )
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder, "mechanism.usda")
            path.write_text(usd, encoding="utf-8")
            cfg = scenes.InteractiveSceneCfg(num_envs=lanes, env_spacing=1.0)
            cfg.robot = _articulation(str(path))
            self._scene = scenes.InteractiveScene(cfg)
            self._sim.reset()
        self._robot = self._scene["robot"]
        names = [f"{name}_joint" for name in joints]
        self._order, _ = self._robot.find_joints(names, preserve_order=True)
        self._solver = import_module("isaaclab_newton.physics").NewtonManager._solver
        return {name: version(name) for name in PACKAGES}

    def run(self, starts: list[list[float]], count: int) -> list[list[float]]:
        """Take some steps of the first lanes: rows of q, v and force to rows of q and v."""
        torch = import_module("torch")
        given = torch.zeros(self._scene.num_envs, 3 * len(self._order))
        given[: len(starts)] = torch.tensor(starts)
        q, v, force = given.split(len(self._order), dim=1)
        robot, ids = self._robot, self._order
        robot.write_joint_position_to_sim_index(position=q.contiguous(), joint_ids=ids)
        robot.write_joint_velocity_to_sim_index(velocity=v.contiguous(), joint_ids=ids)
        robot.set_joint_effort_target_index(target=force.contiguous(), joint_ids=ids)
        for _ in range(count):
            self._from_nothing()
            self._scene.write_data_to_sim()
            self._sim.step(render=False)
            self._scene.update(self._dt)
        ends = (robot.data.joint_pos.torch[:, ids], robot.data.joint_vel.torch[:, ids])
        rows: list[list[float]] = torch.cat(ends, dim=1)[: len(starts)].tolist()
        return rows

    def at_rest(self, q: list[float]) -> tuple[list[list[float]], list[float]]:
        """Mass matrix and all of the generalized force of the first lane at rest in ``q``."""
        still = [0.0] * len(q)
        self.run([[*q, *still, *still]], 1)
        if not hasattr(self._solver, "mjw_model"):
            mass = self._solver.H.numpy()[: len(q) ** 2].reshape(len(q), len(q))
            return mass.tolist(), self._solver.joint_tau.numpy()[: len(q)].tolist()
        model, data = self._solver.mjw_model, self._solver.mjw_data
        data.qpos.assign([q] * self._scene.num_envs)
        data.qvel.zero_()
        import_module("mujoco_warp").forward(model, data)
        force: list[float] = data.qfrc_smooth.numpy()[0].tolist()
        return _dense(model, data, len(q)), force

    def _from_nothing(self) -> None:
        """Let the constraint solver start without a guess."""
        data = getattr(self._solver, "mjw_data", None)
        if data is not None:
            data.qacc_warmstart.zero_()


def _dense(model: Any, data: Any, size: int) -> list[list[float]]:
    """Mass matrix of MuJoCo Warp's first world, of which it keeps one triangle's rows."""
    counts, begins, columns = (
        getattr(model, f"M_{name}").numpy() for name in ("rownnz", "rowadr", "colind")
    )
    kept, full = data.M.numpy()[0], [[0.0] * size for _ in range(size)]
    for row in range(size):
        for place in range(begins[row], begins[row] + counts[row]):
            column = columns[place]
            full[row][column] = full[column][row] = float(kept[place])
    return full


def _physics(integrator: str) -> Any:
    """Configuration of Newton; Featherstone's own angular damping of 0.05 1/s is turned off."""
    physics = import_module("isaaclab_newton.physics")
    if integrator == "featherstone":
        solver = physics.FeatherstoneSolverCfg(angular_damping=0.0)
    else:
        solver = physics.MJWarpSolverCfg(
            integrator=integrator, njmax=ROWS, nconmax=1, disable_contacts=True
        )
    return physics.NewtonCfg(num_substeps=1, use_cuda_graph=False, solver_cfg=solver)


def _articulation(path: str) -> Any:
    """An articulation whose actuators add nothing to the effort that is asked for."""
    actuators, assets = import_module("isaaclab.actuators"), import_module("isaaclab.assets")
    passive = actuators.ImplicitActuatorCfg(
        joint_names_expr=[".*_joint"], stiffness=0.0, damping=0.0, joint_effort_limit=UNLIMITED
    )
    spawn = import_module("isaaclab.sim").UsdFileCfg(usd_path=path)
    prim = "{ENV_REGEX_NS}/Robot"
    return assets.ArticulationCfg(prim_path=prim, spawn=spawn, actuators={"all": passive})
