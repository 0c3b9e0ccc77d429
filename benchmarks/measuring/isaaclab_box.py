"""A box on Isaac Lab's ground plane, served by Isaac Lab's interpreter, apart from integ-gym."""

from __future__ import annotations

import tempfile
from importlib import import_module
from pathlib import Path
from typing import Any

GROUND = """#usda 1.0
(
    defaultPrim = "ground"
    metersPerUnit = 1
    upAxis = "Z"
)
def Xform "ground"
{
    def Plane "plane" (prepend apiSchemas = ["PhysicsCollisionAPI"])
    {
        uniform token axis = "Z"
    }
}
"""
"""Isaac Lab's own ground plane comes from the web."""


class Served:
    """One scene with a box over the ground, by Newton's MuJoCo solver."""

    def make(
        self, integrator: str, dt: float, sides: list[float], mass: float, gravity: float,
        friction: float,
    ) -> None:  # fmt: skip
        """Make the scene in place of any that was there before; in SI units."""
        sims, assets = import_module("isaaclab.sim"), import_module("isaaclab.assets")
        scenes, physics = import_module("isaaclab.scene"), import_module("isaaclab_newton.physics")
        solver = physics.MJWarpSolverCfg(integrator=integrator)
        moved = physics.NewtonCfg(num_substeps=1, use_cuda_graph=False, solver_cfg=solver)
        sims.SimulationContext.clear_instance()
        self._dt = dt
        self._sim = sims.SimulationContext(
            sims.SimulationCfg(dt=dt, device="cpu", gravity=(0.0, 0.0, -gravity), physics=moved)
        )
        rubs = sims.RigidBodyMaterialCfg(
            static_friction=friction, dynamic_friction=friction, restitution=0.0
        )
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder, "ground.usda")
            path.write_text(GROUND, encoding="utf-8")
            cfg = scenes.InteractiveSceneCfg(num_envs=1, env_spacing=1.0)
            ground = sims.GroundPlaneCfg(usd_path=str(path), physics_material=rubs)
            cfg.ground = assets.AssetBaseCfg(prim_path="/World/ground", spawn=ground)
            cfg.box = assets.RigidObjectCfg(
                prim_path="{ENV_REGEX_NS}/Box",
                spawn=sims.CuboidCfg(
                    size=tuple(sides),
                    mass_props=sims.MassPropertiesCfg(mass=mass),
                    rigid_props=sims.RigidBodyPropertiesCfg(),
                    collision_props=sims.CollisionPropertiesCfg(),
                    physics_material=rubs,
                ),
            )
            self._scene = scenes.InteractiveScene(cfg)
            self._sim.reset()
        self._box: Any = self._scene["box"]

    def start(self, height: float, speed: float) -> None:
        """Put the box's centre so high, m, at a speed along the ground, m/s."""
        torch = import_module("torch")
        pose = torch.tensor([[0.0, 0.0, height, 0.0, 0.0, 0.0, 1.0]])
        velocity = torch.tensor([[speed, 0.0, 0.0, 0.0, 0.0, 0.0]])
        self._scene.reset()
        self._box.write_root_pose_to_sim_index(root_pose=pose)
        self._box.write_root_velocity_to_sim_index(root_velocity=velocity)

    def step(self) -> tuple[float, float, float, float]:
        """Take one: height of the centre, m, way, m, speeds up and along, m/s."""
        self._scene.write_data_to_sim()
        self._sim.step(render=False)
        self._scene.update(self._dt)
        place = self._box.data.root_link_pos_w.torch[0].tolist()
        speed = self._box.data.root_com_lin_vel_w.torch[0].tolist()
        return place[2], place[0], speed[2], speed[0]
