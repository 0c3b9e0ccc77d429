"""A published robot by MuJoCo, NumPy and onnxruntime alone, beside the records of a run.

``python benchmarks/robot_plain.py go1 DIR RUN 100``: DIR has the robot's files and ``policy.onnx``,
RUN is of ``integ-gym evaluate``. Of each cell 100 episodes are run again if they are of this
version of MuJoCo. Printed is how many are the same, and processor time for 10 s of motion.
"""

import json
import sys
import time
from itertools import groupby
from pathlib import Path

import mujoco
import numpy as np
import onnxruntime
import pyarrow.parquet as pq


def plain_episode(name, model, session, qpos, qvel, command, period=0.02, late=0.0, seen_late=0.0):
    """Control instants' states, whether it has not fallen, and the error of what is commanded."""
    data, key = mujoco.MjData(model), model.key(0 if name not in ("g1", "apollo") else "knees_bent")
    data.qpos[:], data.qvel[:] = qpos, qvel
    rate = 1.25 + 0.5 * min(np.linalg.norm(command), 1.5) / 1.5 if name == "apollo" else 1.5
    suffix, hidden = "_pelvis" if name == "g1" else "", 2 if name == "t1" else 0

    def look(decision, action):
        mujoco.mj_forward(model, data)
        gravity = -data.site("imu_in_pelvis" if suffix else "imu").xmat.reshape(3, 3)[2]
        velocity, spin = (data.sensor(f"{one}{suffix}").data for one in ("local_linvel", "gyro"))
        angles, speeds = data.qpos[7:] - key.qpos[7:], data.qvel[6:].copy()
        angles[:hidden] = speeds[:hidden] = 0.0
        phases = 2.0 * np.pi * rate * (decision * period) + np.array([0.0, np.pi])
        phases += (name in ("t1", "apollo") and np.linalg.norm(command) < 0.01) * (np.pi - phases)
        joints, clock = [angles, speeds, action], [np.cos(phases), np.sin(phases)]
        further = [*joints, command] if name == "go1" else [command, *joints, *clock]
        error = np.sum((np.append(velocity[:2], spin[2]) - command) ** 2)
        return np.concatenate([velocity, spin, gravity, *further]), gravity[2] <= -0.5, error

    steps, wait, old = (round(time / model.opt.timestep) for time in (period, late, seen_late))
    (periods, behind), states, squares, controls = divmod(old, steps), [], 0.0, {}
    seen = [look(0, np.zeros(model.nu))[0]] * (periods + 1)
    for decision in range(int(np.ceil(round(10.0 / period, 6)))):
        (action,) = session.run(None, {"obs": seen[decision][None].astype(np.float32)})[0]
        controls[decision] = key.ctrl + (1.0 if name == "t1" else 0.5) * action.astype(np.float64)
        done, newest, looks = 0, decision - wait // steps, []
        for stop in sorted({wait % steps, steps - behind, steps} - {0}):
            data.ctrl[:] = controls.get(newest - (stop <= wait % steps), key.ctrl)
            mujoco.mj_step(model, data, stop - done)
            if (done := stop) in (steps - behind, steps):
                looks.append(look(decision + 1, action))
        states.append(np.concatenate([data.qpos, data.qvel]))
        seen.append(looks[0][0])
        squares += looks[-1][2]
        if not (stands := looks[-1][1]):
            break
    return states, stands, np.sqrt(squares / len(states))


def main(robot, folder, run, episodes):
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    session = onnxruntime.InferenceSession(f"{folder}/policy.onnx", options)
    spec = mujoco.MjSpec.from_file(f"{folder}/scene_mjx_feetonly_flat_terrain.xml")
    for one in [*(one for one in spec.geoms if one.meshname), *spec.meshes]:
        spec.delete(one)
    model = spec.compile()
    option, bits, most = model.opt, mujoco.mjtDisableBit, {"go1": 0.4, "g1": 1.0}.get(robot, 0.7)
    ours = [("engine_version", "==", mujoco.__version__), ("policy_id", "==", "policy")]
    commands, kinds = ["v_x", "v_y", "yaw_rate"], mujoco.mjtIntegrator
    for file in sorted(Path(run, "evidence").glob("evaluate-policy*.parquet")):
        rows, names = pq.read_table(file, filters=ours).to_pylist(), pq.read_schema(file).names
        states = names[names.index("time") + 1 : names.index("sensed_obs0")]
        for cell, recorded in groupby(rows, lambda row: row["cell"]):
            count = np.zeros(5)
            for row in list(recorded)[: int(episodes)]:
                own = {name: x["value"] for name, x in json.loads(row["arguments"]).items()}
                option.timestep, solver, period = own["dt"], own["solver"], own["control_period"]
                option.integrator = getattr(kinds, f"mjINT_{own['integrator'].upper()}")
                for name in ("iterations", "ls_iterations", "tolerance", "ls_tolerance"):
                    setattr(option, name, solver[name])
                option.disableflags |= int(bits.mjDSBL_EULERDAMP | bits.mjDSBL_AUTORESET)
                option.disableflags ^= int(bits.mjDSBL_EULERDAMP) * solver["eulerdamp"]
                timing = period, *(own.get(f"{x}_latency", 0.0) for x in ("action", "observation"))
                trace = np.array([row[name] for name in states]).T
                start = *np.split(trace[0], [model.nq]), [row[f"command_{x}"][0] for x in commands]
                begin = time.process_time()
                found, stands, error = plain_episode(robot, model, session, *start, *timing)
                spent = (time.process_time() - begin) / (len(found) * period)
                same = [len(found), stands and error <= most] == [row["length"], row["success"]]
                count += [1, stands, same, np.array_equal(found, trace[1:]), spent]
            words = "{:g} episodes, {:g} hold, {:g} the same, {:g} to the last bit".format(*count)
            print(f"{cell}: {words}, {1e4 * count[4] / count[0]:.0f} ms", flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
