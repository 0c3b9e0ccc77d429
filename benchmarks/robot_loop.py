"""Published robots in a loop of MuJoCo and onnxruntime alone, beside a testbed's episodes.

``python benchmarks/robot_loop.py go1:Go1 DIR``, with its files and its ``policy.onnx`` in DIR.
"""

import mujoco
import numpy as np
from robots import decisions, open_robot, robot_parser

from integ_gym import Discretization


def load_model(path):
    spec = mujoco.MjSpec.from_file(str(path))
    for geom in [one for one in spec.geoms if one.type == mujoco.mjtGeom.mjGEOM_MESH]:
        spec.delete(geom)
    for mesh in list(spec.meshes):
        spec.delete(mesh)
    return spec.compile()


def plain_episode(name, model, session, qpos, qvel, command):
    """Control instants' states, and whether it has not fallen."""
    data, key = (
        mujoco.MjData(model),
        model.key("knees_bent" if name in ("g1", "apollo") else "home"),
    )
    data.qpos[:], data.qvel[:], data.ctrl[:] = qpos, qvel, key.ctrl
    suffix, site = ("_pelvis", "imu_in_pelvis") if name == "g1" else ("", "imu")
    rate = 1.25 + 0.5 * min(np.linalg.norm(command), 1.5) / 1.5 if name == "apollo" else 1.5
    action, states, hidden = np.zeros(model.nu), [], 2 if name == "t1" else 0
    for decision in range(501):  # the last of them ends the episode
        mujoco.mj_forward(model, data)
        gravity = data.site(site).xmat.reshape(3, 3).T @ np.array([0.0, 0.0, -1.0])
        if decision and (gravity[2] > -0.5 or decision == 500):
            break
        angles, speeds = data.qpos[7:] - key.qpos[7:], data.qvel[6:].copy()
        angles[:hidden] = speeds[:hidden] = 0.0
        phases = 2.0 * np.pi * rate * (decision * 0.02) + np.array([0.0, np.pi])
        body = [data.sensor(f"{one}{suffix}").data for one in ("local_linvel", "gyro")]
        joints = [angles, speeds, action]
        clock = [command, *joints, np.cos(phases), np.sin(phases)]
        seen = np.concatenate([*body, gravity, *([*joints, command] if name == "go1" else clock)])
        (action,) = session.run(None, {"obs": seen[None].astype(np.float32)})[0]
        data.ctrl[:] = key.ctrl + (1.0 if name == "t1" else 0.5) * action.astype(np.float64)
        mujoco.mj_step(model, data, round(0.02 / model.opt.timestep))
        states.append(np.concatenate([data.qpos, data.qvel]))
    return states, gravity[2] <= -0.5


def main():
    given = robot_parser(__doc__, 10).parse_args()
    name, (testbed, session) = given.robot.partition(":")[0], open_robot(given)
    own, home = load_model(testbed.model(given.folder)), testbed.home
    filed = home.integrator, own.opt.iterations
    others = [(one, count) for one in ("Euler", "implicitfast") for count in (1, 100)]
    for integrator, iterations in [filed, *others]:
        own.opt.iterations = iterations
        own.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator.upper()}")
        place = Discretization(integrator, home.dt, home.control_period, home.engine)
        (env,) = testbed.make(place, 1, solver={"iterations": iterations}).envs
        succeeded = equal = 0
        for seed in range(given.episodes):
            observation, info = env.reset(seed=seed)
            data, states = env.unwrapped.data, []
            start = data.qpos.copy(), data.qvel.copy(), info["command"]
            for info in decisions(env, session, observation):
                states.append(np.concatenate([data.qpos, data.qvel]))
                success = info["success"]
            expected, lasts = plain_episode(name, own, session, *start)
            succeeded += lasts
            equal += np.array_equal(expected, states) and lasts >= success
        print(f"{integrator} iterations={iterations}: {succeeded} succeed, {equal} equal")


if __name__ == "__main__":
    main()
