"""Published robots by MuJoCo, NumPy and onnxruntime alone: their models, and a policy's episode."""

import math

import mujoco
import numpy as np


def load_model(path):
    spec = mujoco.MjSpec.from_file(str(path))
    for geom in [one for one in spec.geoms if one.type == mujoco.mjtGeom.mjGEOM_MESH]:
        spec.delete(geom)
    for mesh in list(spec.meshes):
        spec.delete(mesh)
    return spec.compile()


def plain_episode(name, model, session, qpos, qvel, command, period=0.02, late=0.0):
    """Control instants' states, whether it has not fallen, and the error of what is commanded."""
    data = mujoco.MjData(model)
    key = model.key("knees_bent" if name in ("g1", "apollo") else "home")
    data.qpos[:], data.qvel[:], data.ctrl[:] = qpos, qvel, key.ctrl
    suffix, site = ("_pelvis", "imu_in_pelvis") if name == "g1" else ("", "imu")
    rate = 1.25 + 0.5 * min(np.linalg.norm(command), 1.5) / 1.5 if name == "apollo" else 1.5
    hidden, last = 2 if name == "t1" else 0, math.ceil(round(10.0 / period, 6))
    count, wait = (round(time / model.opt.timestep) for time in (period, late))
    action, states, squares, controls = np.zeros(model.nu), [], 0.0, {}
    for decision in range(last + 1):  # the last of them ends the episode
        mujoco.mj_forward(model, data)
        gravity = data.site(site).xmat.reshape(3, 3).T @ np.array([0.0, 0.0, -1.0])
        body = [data.sensor(f"{one}{suffix}").data for one in ("local_linvel", "gyro")]
        if decision:
            squares += np.sum((np.append(body[0][:2], body[1][2]) - command) ** 2)
            if decision == last or not gravity[2] <= -0.5:
                break
        angles, speeds = data.qpos[7:] - key.qpos[7:], data.qvel[6:].copy()
        angles[:hidden] = speeds[:hidden] = 0.0
        phases = 2.0 * np.pi * rate * (decision * period) + np.array([0.0, np.pi])
        joints = [angles, speeds, action]
        clock = [command, *joints, np.cos(phases), np.sin(phases)]
        seen = np.concatenate([*body, gravity, *([*joints, command] if name == "go1" else clock)])
        (action,) = session.run(None, {"obs": seen[None].astype(np.float32)})[0]
        controls[decision] = key.ctrl + (1.0 if name == "t1" else 0.5) * action.astype(np.float64)
        newest = decision - wait // count
        for at, steps in ((newest - 1, wait % count), (newest, count - wait % count)):
            data.ctrl[:] = controls.get(at, key.ctrl)
            mujoco.mj_step(model, data, steps)
        states.append(np.concatenate([data.qpos, data.qvel]))
    return states, gravity[2] <= -0.5, np.sqrt(squares / decision)
