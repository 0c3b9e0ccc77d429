"""The hopper on simulators' own ground: their mechanism of it, with a small ball for a foot.

The middle of the ball is the foot, and the ground is the ball's radius lower. Contact has the
simulator's default parameters, but for the coefficient of friction, and no restitution. A motion is
a generator of (q, v), one entry for each step.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, ClassVar

from integ_gym.envs.engines.dart import DartEngine
from integ_gym.envs.engines.drake import hang_link
from integ_gym.envs.engines.pybullet import PybulletEngine
from integ_gym.envs.engines.rigid import RigidBodyEngine, mjcf
from integ_gym.envs.engines.simulator import load_undisturbed
from integ_gym.envs.ops.ops import SCALAR, Components
from integ_gym.envs.plants.hopper import Hopper
from integ_gym.envs.plants.system import PlantSystem

from .boxes import (
    States,
    drake_ground,
    drake_states,
    mjx_states,
    mujoco_states,
    mujoco_warp_states,
)

BALL = 0.005
"""Radius, m."""
State = tuple[Components, Components]
Motion = Iterator[State]


class Groundless(Hopper):
    """The hopper without a ground of ours."""

    contacts: ClassVar[tuple[Any, ...]] = ()


GROUNDLESS = Groundless()
MECHANISM = GROUNDLESS.mechanism.solid
FRICTION = GROUNDLESS.ground_friction


def _hopper_in_mujoco(
    states: Callable[[Any, Any], States],
) -> Callable[[str, float, State], Motion]:
    """The hopper in MuJoCo's terms, moved by what gives its states."""

    def motion(integrator: str, dt: float, start: State) -> Motion:
        import mujoco as mj

        spec = mj.MjSpec.from_string(mjcf(MECHANISM, dt, integrator))
        spec.option.disableflags &= ~int(mj.mjtDisableBit.mjDSBL_CONTACT)
        rubs = [FRICTION, 0.005, 0.0001]
        spec.worldbody.add_geom(
            type=mj.mjtGeom.mjGEOM_PLANE, size=[9.0, 9.0, 1.0], pos=[0.0, 0.0, -BALL], friction=rubs
        )
        spec.body("leg").add_geom(type=mj.mjtGeom.mjGEOM_SPHERE, size=[BALL, 0, 0], friction=rubs)
        model = spec.compile()
        data = mj.MjData(model)
        data.qpos[:], data.qvel[:] = start
        for q, v in states(model, data):
            yield tuple(map(float, q)), tuple(map(float, v))

    return motion


def drake(integrator: str, dt: float, start: State) -> Motion:
    """Point contact with Drake's default compliance."""
    from pydrake.geometry import Sphere
    from pydrake.math import RigidTransform

    builder, plant, rubs = drake_ground(integrator, dt, MECHANISM.gravity, FRICTION, BALL)
    parent = plant.world_frame()
    for link, offset in zip(MECHANISM.links, MECHANISM.offsets, strict=True):
        parent = hang_link(plant, parent, link, offset)
    plant.RegisterCollisionGeometry(parent.body(), RigidTransform(), Sphere(BALL), "foot", rubs)
    for q, v in drake_states(builder, plant, dt, *start):
        yield tuple(q), tuple(v)


class GroundedDart(DartEngine):
    """A linear complementarity problem in each step."""

    def build(self) -> None:
        super().build()
        dart = load_undisturbed("dartpy", "dart")
        ground = dart.dynamics.Skeleton("ground")
        floor, foot = ground.createWeldJointAndBodyNodePair()[1], self._skeleton.getBodyNode(4)
        for node, form, down in (
            (floor, dart.dynamics.BoxShape((20.0, 20.0, 1.0)), -0.5 - BALL),
            (foot, dart.dynamics.SphereShape(BALL), 0.0),
        ):
            shape = node.createShapeNode(form)
            place = dart.math.Isometry3()
            place.set_translation([0.0, 0.0, down])
            shape.setRelativeTransform(place)
            shape.createCollisionAspect()
            shape.createDynamicsAspect().setFrictionCoeff(FRICTION)
        self._world.addSkeleton(ground)


class GroundedBullet(PybulletEngine):
    """Sequential impulses."""

    def text(self) -> str:
        ball = f'<collision><geometry><sphere radius="{BALL}"/></geometry></collision>'
        before, after = super().text().rsplit("</inertial>", 1)
        return f"{before}</inertial>{ball}{after}"

    def build(self) -> None:
        super().build()
        bullet, own = self._bullet, {"physicsClientId": self._client}
        plane = bullet.createCollisionShape(bullet.GEOM_PLANE, **own)
        ground = bullet.createMultiBody(0.0, plane, basePosition=(0.0, 0.0, -BALL), **own)
        bullet.changeDynamics(ground, -1, lateralFriction=1.0, **own)
        bullet.changeDynamics(self._body, 4, lateralFriction=FRICTION, **own)


def _engine_states(kind: type[RigidBodyEngine]) -> Callable[[str, float, State], Motion]:
    def motion(integrator: str, dt: float, start: State) -> Motion:
        engine, (q, v) = kind(PlantSystem(GROUNDLESS), integrator, dt), start
        while True:
            end = engine.advance(SCALAR, q, v, (((0.0, 0.0), 1),), None)
            q, v = end.q, end.v
            yield q, v

    return motion


HOPPERS: dict[str, Callable[[str, float, State], Motion]] = {
    "mujoco": _hopper_in_mujoco(mujoco_states),
    "mjx": _hopper_in_mujoco(mjx_states),
    "mujoco_warp": _hopper_in_mujoco(mujoco_warp_states),
    "pybullet": _engine_states(GroundedBullet),
    "dart": _engine_states(GroundedDart),
    "drake": drake,
}
"""By engine."""
