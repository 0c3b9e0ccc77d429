"""One position servo computed in three ways, and which of them simulators' own servos are.

    python benchmarks/servo.py

An arm without gravity, I = 1/3 kg m², is sent 0.5 rad away by a servo of 40 N m/rad and
6 N m s/rad, at a control period of 0.02 s and a step of 0.004 s. Printed are the traces; the
largest damping with which a servo of no stiffness is stable, beside theory; and the servos of
MuJoCo, PhysX (by SAPIEN) and PyBullet on the same arm, beside the law that they are said to be:
largest difference over a second.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import gymnasium as gym
import mujoco
import numpy as np
from numpy.typing import NDArray

import integ_gym  # noqa: F401
from integ_gym.envs.engines.sapien import _put
from integ_gym.envs.environment import environment_setup

INERTIA, STIFFNESS, DAMPING, TARGET = 1.0 / 3.0, 40.0, 6.0, 0.5
DT, PERIOD, DURATION = 0.004, 0.02, 1.0
DECISIONS, SUBSTEPS = round(DURATION / PERIOD), round(PERIOD / DT)
WAYS: dict[str, dict[str, Any]] = {
    "continuous": {},
    "step": {"servo": "step"},
    "period": {"servo": "period", "servo_period": PERIOD},
}
IMPLICIT_VELOCITY = "integ_gym.envs.engines.maps:SymplecticEulerImplicitVelocity"
STABLE_UP_TO = {"explicit_euler": 2.0, "rk4": 2.785293563405282, "implicit_midpoint": math.inf}
"""h d / I of a continuous servo of damping alone: where the map of ẋ = -λx has |R(hλ)| = 1."""

Trace = NDArray[np.float64]


def moved(integrator: str, way: str, dt: float = DT, speed: float = 0.0, **given: Any) -> Trace:
    """(θ, θ̇) after every control period, shape (decisions, 2)."""
    env = gym.make(
        "IntegPendulum-v0",
        **{
            "gravity": 0.0, "max_torque": 1e9, "actuator": "position", "integrator": integrator,
            "dt": dt, "control_period": PERIOD, "servo_stiffness": STIFFNESS,
            "servo_damping": DAMPING, **WAYS[way], **given,
        },
    )  # fmt: skip
    env.reset(options={"state": (0.0, speed)})
    states = []
    for _ in range(DECISIONS):
        terminated = env.step(np.array([TARGET]))[2]
        states.append(env.unwrapped.state)  # type: ignore[attr-defined]
        if terminated:
            states[-1] = np.full(2, math.inf)
            break
    return np.array(states)


def largest_damping(integrator: str, way: str) -> float:
    """Up to which the speed decays, as h d / I with h what the servo holds; inf: at any tried."""
    low, high = 0.0, 40.0
    held = PERIOD if way == "period" else DT
    for _ in range(24):
        middle = 0.5 * (low + high)
        given = {"servo_stiffness": 1e-12, "servo_damping": middle * INERTIA / held}
        decays = abs(moved(integrator, way, speed=1.0, **given)[-1, 1]) < 1.0
        low, high = (middle, high) if decays else (low, middle)
    return low if low < 39.9 else math.inf


def mujoco_servo(integrator: str) -> Trace:
    """MuJoCo's position actuator with `kv`."""
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><option timestep="{DT}" integrator="{integrator}" gravity="0 0 0"/><worldbody>'
        '<body><joint name="joint" type="hinge" axis="0 1 0"/>'
        f'<inertial pos="0 0 0" mass="1" diaginertia="{INERTIA} {INERTIA} {INERTIA}"/></body>'
        f'</worldbody><actuator><position joint="joint" kp="{STIFFNESS}" kv="{DAMPING}"/>'
        "</actuator></mujoco>"
    )
    data = mujoco.MjData(model)
    data.ctrl[0] = TARGET
    states = []
    for _ in range(DECISIONS):
        mujoco.mj_step(model, data, SUBSTEPS)
        states.append((data.qpos[0], data.qvel[0]))
    return np.array(states)


def _engine(engine: str, integrator: str) -> Any:
    given = {"gravity": 0.0, "engine": engine, "integrator": integrator, "dt": DT}
    return environment_setup("IntegPendulum-v0", given).engine


def physx_servo(solver: str) -> Trace:
    """PhysX's drive of a joint, in float32."""
    _, system, articulation = _engine("sapien", solver)._world
    (joint,) = articulation.get_active_joints()
    joint.set_drive_properties(STIFFNESS, DAMPING, 1e9, "force")
    joint.set_drive_target(TARGET)
    _put(articulation, (0.0,), (0.0,), (0.0,))
    states = []
    for _ in range(DECISIONS):
        for _ in range(SUBSTEPS):
            system.step()
        states.append((float(articulation.get_qpos()[0]), float(articulation.get_qvel()[0])))
    return np.array(states)


def bullet_servo(gains: tuple[float, float]) -> tuple[Trace, Trace]:
    """PyBullet's POSITION_CONTROL with gains of its own, and the law that it is."""
    engine = _engine("pybullet", "semi_implicit_euler")
    bullet, body, client = engine._bullet, engine._body, engine._client
    bullet.resetJointState(body, 0, 0.0, 0.0, client)
    (q, v), states, expected = (0.0, 0.0), [], []
    for step in range(DECISIONS * SUBSTEPS):
        bullet.setJointMotorControl2(
            body, 0, bullet.POSITION_CONTROL, targetPosition=TARGET, positionGain=gains[0],
            velocityGain=gains[1], force=1e9, physicsClientId=client,
        )  # fmt: skip
        bullet.stepSimulation(client)
        v = gains[0] * (TARGET - q) / DT + (1.0 - gains[1]) * v
        q += DT * v
        if step % SUBSTEPS == SUBSTEPS - 1:
            states.append(bullet.getJointState(body, 0, client)[:2])
            expected.append((q, v))
    return np.array(states), np.array(expected)


def lines() -> Iterator[str]:
    """What is printed."""
    truth = moved("reference", "continuous")
    yield "θ (rad) after 0.02, 0.04, 0.1, 0.2 and 1 s; largest difference from the truth"
    for way in WAYS:
        for integrator in ("rk4", "implicit_midpoint"):
            trace = moved(integrator, way)
            angles = "  ".join(f"{trace[k, 0]:.4f}" for k in (0, 1, 4, 9, 49))
            off = np.abs(trace - truth)[:, 0].max()
            yield f"  {way:<10} {integrator:<17} {angles}   {off:.4f}"
    yield "largest stable h d / I, h = 0.004 s, of `period` 0.02 s; measured, theory"
    for way in WAYS:
        for integrator, limit in STABLE_UP_TO.items():
            theory = limit if way == "continuous" else 2.0
            found = largest_damping(integrator, way)
            yield f"  {way:<10} {integrator:<17} {found:8.4f} {theory:8.4f}"
    yield "simulators' own servos: largest difference from the law beside them, rad and rad/s"
    for name, integrator in (
        ("Euler", "symplectic_euler"), ("implicitfast", IMPLICIT_VELOCITY),
        ("implicit", IMPLICIT_VELOCITY), ("RK4", "rk4"),
    ):  # fmt: skip
        off = np.abs(mujoco_servo(name) - moved(integrator, "continuous")).max()
        yield f"  MuJoCo {name:<13} continuous, {integrator.rpartition(':')[2]:<30} {off:.1e}"
    for name, dt in (("pgs", DT), ("tgs", DT / 10)):
        off = np.abs(physx_servo(name) - moved("implicit_euler", "continuous", dt)).max()
        yield f"  PhysX {name:<14} continuous, {f'implicit_euler at {dt:g} s':<30} {off:.1e}"
    for gains in ((0.1, 1.0), (0.02, 0.3)):
        found, law = bullet_servo(gains)
        off = np.abs(found - law).max()
        yield f"  PyBullet {gains!s:<11} v = kp (q* - q) / h + (1 - kd) v{'':<13} {off:.1e}"


if __name__ == "__main__":
    print("\n".join(lines()))
