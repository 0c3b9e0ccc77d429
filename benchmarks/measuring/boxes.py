"""A box on each simulator's own ground: a flat box, dropped while it slides, without a spin.

Contact has the simulator's default parameters, but for a coefficient of friction of 0.5 and no
restitution. A motion is a generator of (height of the lower side, m; way, m; speeds up and along,
m/s), one entry for each step.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import lru_cache
from itertools import product
from math import sqrt
from pathlib import Path
from typing import Any

import numpy as np

from integ_gym.envs.engines.isaaclab import STARTING
from integ_gym.envs.engines.simulator import load_undisturbed
from integ_gym.support.isolated import ISOLATED, Worker

GRAVITY, FRICTION, MASS = 9.81, 0.5, 1.0
HALF = (0.2, 0.2, 0.05)
"""Half the sides, m."""
MOMENTS = tuple(MASS / 3.0 * (sum(x * x for x in HALF) - side * side) for side in HALF)
"""Of inertia, kg m^2."""
FOOT = 0.01
"""Radius of the four spheres at the lower corners that Drake's box stands on, m."""


class SolverGaveUpError(RuntimeError):
    """An engine found no solution of a step."""


Start = tuple[float, float]
"""Height of the lower side, m, and speed along, m/s."""
Motion = Iterator[tuple[float, float, float, float]]
States = Iterator[tuple[Any, Any]]
"""(q, v) after each step."""


def rigid(start: Start) -> tuple[float, float]:
    """When a rigid box that does not bounce lands, s, and how far it has come when it rests, m."""
    height, speed = start
    falls = sqrt(2.0 * height / GRAVITY)
    left = max(0.0, speed - FRICTION * GRAVITY * falls)
    return falls, speed * falls + left * left / (2.0 * FRICTION * GRAVITY)


def mujoco_states(model: Any, data: Any) -> States:
    """(q, v) after each step by MuJoCo: soft contact, its default impedance."""
    import mujoco as mj

    while True:
        mj.mj_step(model, data)
        yield data.qpos, data.qvel


def mjx_states(model: Any, data: Any) -> States:
    """(q, v) after each step by MJX, in float64."""
    import jax
    from mujoco import mjx

    step = jax.jit(mjx.step)
    with jax.enable_x64(True):
        own, state = mjx.put_model(model), mjx.put_data(model, data)
    while True:
        with jax.enable_x64(True):
            state = step(own, state)
        yield np.asarray(state.qpos), np.asarray(state.qvel)


def mujoco_warp_states(model: Any, data: Any) -> States:
    """(q, v) after each step by MuJoCo Warp, in float32, on the CPU."""
    warp = load_undisturbed("warp", "mujoco_warp")
    engine = load_undisturbed("mujoco_warp", "mujoco_warp")
    with warp.ScopedDevice("cpu"):
        own, state = engine.put_model(model), engine.put_data(model, data)
    while True:
        with warp.ScopedDevice("cpu"):
            engine.step(own, state)
        yield state.qpos.numpy()[0], state.qvel.numpy()[0]


def _box_in_mujoco(states: Callable[[Any, Any], States]) -> Callable[[str, float, Start], Motion]:
    """The box in MuJoCo's terms, moved by what gives its states."""

    def motion(integrator: str, dt: float, start: Start) -> Motion:
        import mujoco as mj

        sides = " ".join(map(str, HALF))
        model = mj.MjModel.from_xml_string(
            f'<mujoco><option timestep="{dt}" integrator="{integrator}" gravity="0 0 {-GRAVITY}"/>'
            f'<default><geom friction="{FRICTION} 0.005 0.0001"/></default><worldbody>'
            '<geom type="plane" size="9 9 1"/><body><freejoint/>'
            f'<geom type="box" size="{sides}" mass="{MASS}"/></body></worldbody></mujoco>'
        )
        data = mj.MjData(model)
        data.qpos[2], data.qvel[0] = start[0] + HALF[2], start[1]
        for q, v in states(model, data):
            yield float(q[2]) - HALF[2], float(q[0]), float(v[2]), float(v[0])

    return motion


def newton(integrator: str, dt: float, start: Start) -> Motion:
    """Springs and dampers between shapes, with Newton's default stiffness, in float32."""
    warp, engine = (load_undisturbed(name, "newton") for name in ("warp", "newton"))
    with warp.ScopedDevice("cpu"):
        builder = engine.ModelBuilder(up_axis=engine.Axis.Z, gravity=(0.0, 0.0, -GRAVITY))
        builder.default_shape_cfg.mu = FRICTION
        builder.add_ground_plane()
        height = start[0] + HALF[2]
        body = builder.add_body(xform=warp.transform((0.0, 0.0, height), warp.quat_identity()))
        builder.default_shape_cfg.density = MASS / (8 * HALF[0] * HALF[1] * HALF[2])
        builder.add_shape_box(body, hx=HALF[0], hy=HALF[1], hz=HALF[2])
        builder.joint_qd[0] = start[1]
        model = builder.finalize()
        solver = engine.solvers.SolverFeatherstone(model, angular_damping=0.0)
        now, then, control = model.state(), model.state(), model.control()
        engine.eval_fk(model, model.joint_q, model.joint_qd, now)
        pipeline = engine.CollisionPipeline(model)
        contacts = pipeline.contacts()
    while True:
        with warp.ScopedDevice("cpu"):
            pipeline.collide(now, contacts)
            solver.step(now, then, control, contacts, dt)
        now, then = then, now
        q, v = now.joint_q.numpy().tolist(), now.joint_qd.numpy().tolist()
        yield q[2] - HALF[2], q[0], v[2], v[0]


def pybullet(integrator: str, dt: float, start: Start) -> Motion:
    """Sequential impulses."""
    bullet = load_undisturbed("pybullet", "pybullet")
    client = bullet.connect(bullet.DIRECT)
    own = {"physicsClientId": client}
    try:
        bullet.setGravity(0.0, 0.0, -GRAVITY, **own)
        bullet.setTimeStep(dt, **own)
        shapes = (
            bullet.createCollisionShape(bullet.GEOM_PLANE, **own),
            bullet.createCollisionShape(bullet.GEOM_BOX, halfExtents=HALF, **own),
        )
        ground = bullet.createMultiBody(0.0, shapes[0], **own)
        box = bullet.createMultiBody(
            MASS, shapes[1], basePosition=(0.0, 0.0, start[0] + HALF[2]), **own
        )
        bullet.changeDynamics(ground, -1, lateralFriction=1.0, **own)
        bullet.changeDynamics(
            box, -1, lateralFriction=FRICTION, linearDamping=0.0, angularDamping=0.0, **own
        )
        bullet.resetBaseVelocity(box, (start[1], 0.0, 0.0), **own)
        while True:
            bullet.stepSimulation(**own)
            q = bullet.getBasePositionAndOrientation(box, **own)[0]
            v = bullet.getBaseVelocity(box, **own)[0]
            yield q[2] - HALF[2], q[0], v[2], v[0]
    finally:
        bullet.disconnect(client)


def dart(integrator: str, dt: float, start: Start) -> Motion:
    """A linear complementarity problem in each step."""
    dartpy = load_undisturbed("dartpy", "dart")
    world = dartpy.simulation.World()
    world.setTimeStep(dt)
    world.setGravity([0.0, 0.0, -GRAVITY])
    ground, box = dartpy.dynamics.Skeleton("ground"), dartpy.dynamics.Skeleton("box")
    floor = ground.createWeldJointAndBodyNodePair()[1]
    body = box.createFreeJointAndBodyNodePair()[1]
    for node, sides, down in (
        (floor, (20.0, 20.0, 1.0), -0.5), (body, tuple(2.0 * x for x in HALF), 0.0),
    ):  # fmt: skip
        shape = node.createShapeNode(dartpy.dynamics.BoxShape(sides))
        place = dartpy.math.Isometry3()
        place.set_translation([0.0, 0.0, down])
        shape.setRelativeTransform(place)
        shape.createCollisionAspect()
        shape.createDynamicsAspect().setFrictionCoeff(FRICTION)
    inertia = dartpy.dynamics.Inertia(MASS, [0.0] * 3, [[m * (i == k) for k in range(3)]
                                                       for i, m in enumerate(MOMENTS)])  # fmt: skip
    body.setInertia(inertia)
    for one in (ground, box):
        world.addSkeleton(one)
    box.setPositions([0.0, 0.0, 0.0, 0.0, 0.0, start[0] + HALF[2]])
    box.setVelocities([0.0, 0.0, 0.0, start[1], 0.0, 0.0])
    while True:
        world.step()
        q, v = body.getTransform().translation(), body.getLinearVelocity()
        yield q[2] - HALF[2], q[0], v[2], v[0]


def sapien(integrator: str, dt: float, start: Start) -> Motion:
    """PhysX's rigid bodies, by the solver of a name."""
    module = load_undisturbed("sapien", "sapien")
    from integ_gym.envs.engines.sapien import _system

    system = _system(module.physx, GRAVITY, integrator == "tgs")
    system.timestep = dt
    scene = module.Scene([system])
    material = module.physx.PhysxMaterial(FRICTION, FRICTION, 0.0)
    scene.add_ground(0.0, render=False, material=material)
    builder = scene.create_actor_builder()
    builder.add_box_collision(
        half_size=HALF, material=material, density=MASS / (8 * HALF[0] * HALF[1] * HALF[2])
    )
    builder.set_initial_pose(module.Pose([0.0, 0.0, start[0] + HALF[2]]))
    actor = builder.build()
    body = actor.find_component_by_type(module.physx.PhysxRigidDynamicComponent)
    body.linear_damping = body.angular_damping = 0.0
    body.linear_velocity = [start[1], 0.0, 0.0]
    while True:
        system.step()
        q, v = body.entity_pose.p, body.linear_velocity
        yield float(q[2]) - HALF[2], float(q[0]), float(v[2]), float(v[0])


def isaaclab(integrator: str, dt: float, start: Start) -> Motion:
    """Newton's MuJoCo solver in Isaac Lab's scene, in float32, in a process of its own."""
    served = _isaaclab_scene(integrator, dt)
    served.call("start", height=start[0] + HALF[2], speed=start[1])
    while True:
        height, way, rising, along = served.call("step", STARTING)  # the first compiles
        yield height - HALF[2], way, rising, along


@lru_cache(maxsize=1)
def _isaaclab_scene(integrator: str, dt: float) -> Worker:
    """The process whose scene has this step; that of another step ends."""
    served = ISOLATED["isaaclab"].start(Path(__file__).with_name("isaaclab_box.py"))
    served.call(
        "make", STARTING, integrator=integrator, dt=dt, sides=[2.0 * x for x in HALF], mass=MASS,
        gravity=GRAVITY, friction=FRICTION,
    )  # fmt: skip
    return served


def drake(integrator: str, dt: float, start: Start) -> Motion:
    """Point contact with Drake's default compliance, at four small spheres: a box has one point."""
    from pydrake.geometry import Sphere
    from pydrake.math import RigidTransform
    from pydrake.multibody.tree import SpatialInertia, UnitInertia

    builder, plant, rubs = drake_ground(integrator, dt, GRAVITY, FRICTION)
    about = UnitInertia(*[m / MASS for m in MOMENTS])
    body = plant.AddRigidBody("box", SpatialInertia(MASS, [0.0] * 3, about))
    for i, (x, y) in enumerate(product((-1, 1), repeat=2)):
        corner = RigidTransform([x * HALF[0], y * HALF[1], FOOT - HALF[2]])
        plant.RegisterCollisionGeometry(body, corner, Sphere(FOOT), f"foot{i}", rubs)
    place = [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, start[0] + HALF[2]]
    for q, v in drake_states(builder, plant, dt, place, [0.0, 0.0, 0.0, start[1], 0.0, 0.0]):
        yield q[6] - HALF[2], q[4], v[5], v[3]


def drake_ground(
    integrator: str, dt: float, gravity: float, friction: float, depth: float = 0.0
) -> tuple[Any, Any, Any]:
    """A builder, an empty discrete plant over a ground so deep, m, and how that rubs."""
    from pydrake.geometry import HalfSpace
    from pydrake.math import RigidTransform
    from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, CoulombFriction
    from pydrake.multibody.plant import DiscreteContactApproximation as Approximation
    from pydrake.systems.framework import DiagramBuilder

    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlantSceneGraph(builder, dt)
    plant.set_discrete_contact_approximation(
        Approximation.__members__[f"k{integrator.capitalize()}"]
    )
    plant.mutable_gravity_field().set_gravity_vector([0.0, 0.0, -gravity])
    rubs = CoulombFriction(friction, friction)
    place = RigidTransform([0.0, 0.0, -depth])
    plant.RegisterCollisionGeometry(plant.world_body(), place, HalfSpace(), "ground", rubs)
    return builder, plant, rubs


def drake_states(
    builder: Any, plant: Any, dt: float, q: Sequence[float], v: Sequence[float]
) -> States:
    """(q, v) after each step from these.

    Raises:
        SolverGaveUpError: where the solver does not converge.
    """
    from pydrake.systems.analysis import Simulator

    plant.Finalize()
    diagram = builder.Build()
    simulator = Simulator(diagram)
    context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    plant.SetPositions(context, q)
    plant.SetVelocities(context, v)
    simulator.Initialize()
    done = 0
    while True:
        done += 1
        try:
            simulator.AdvanceTo(done * dt)
        except RuntimeError as error:
            if "failed to converge" in str(error):
                raise SolverGaveUpError(str(error)) from error
            raise
        yield plant.GetPositions(context), plant.GetVelocities(context)


BOXES: dict[str, Callable[[str, float, Start], Motion]] = {
    "mujoco": _box_in_mujoco(mujoco_states),
    "mjx": _box_in_mujoco(mjx_states),
    "mujoco_warp": _box_in_mujoco(mujoco_warp_states),
    "newton": newton,
    "pybullet": pybullet,
    "dart": dart,
    "sapien": sapien,
    "drake": drake,
    "isaaclab": isaaclab,
}
"""By engine."""
