"""Records of a published robot beside a loop of MuJoCo, NumPy and onnxruntime alone.

``python benchmarks/robot_records.py go1 DIR RUN``: the robot's files and its ``policy.onnx`` are in
DIR, RUN is of ``integ-gym evaluate``, read by pyarrow. Each episode of the policy is run again from
its start, under its command, but for late observations and other versions of MuJoCo.
"""

import argparse
import json
from pathlib import Path

import mujoco
import numpy as np
import onnxruntime
import pyarrow.parquet as pq
from robot_plain import load_model, plain_episode


def settle(model, own):
    """Set what a record's arguments say."""
    model.opt.timestep = own["dt"]
    model.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{own['integrator'].upper()}")
    for name in ("iterations", "ls_iterations", "tolerance", "ls_tolerance"):
        setattr(model.opt, name, own["solver"][name])
    explicit, kept = (
        getattr(mujoco.mjtDisableBit, f"mjDSBL_{n}") for n in ("EULERDAMP", "AUTORESET")
    )
    model.opt.disableflags |= int(explicit | kept)
    if own["solver"]["eulerdamp"]:
        model.opt.disableflags &= ~int(explicit)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    for given in ("robot", "folder", "run"):
        parser.add_argument(given)
    given, options = parser.parse_args(), onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    session = onnxruntime.InferenceSession(f"{given.folder}/policy.onnx", options)
    model = load_model(f"{given.folder}/scene_mjx_feetonly_flat_terrain.xml")
    most = {"go1": 0.4, "g1": 1.0}.get(given.robot, 0.7)
    commands, counts = ["command_v_x", "command_v_y", "command_yaw_rate"], {}
    for file in sorted(Path(given.run, "evidence").glob("evaluate-policy*.parquet")):
        names = pq.read_schema(file).names
        states = names[names.index("time") + 1 : names.index("sensed_obs0")]
        columns = ["cell", "arguments", "perturbation", "length", "success", *states, *commands]
        for row in pq.read_table(file, columns=columns).to_pylist():
            own = {name: one["value"] for name, one in json.loads(row["arguments"]).items()}
            if own.get("observation_latency") or "packages" in (row["perturbation"] or ""):
                continue
            settle(model, own)
            trace = np.array([row[name] for name in states]).T
            start, command = np.split(trace[0], [model.nq]), [row[name][0] for name in commands]
            timing = own["control_period"], own.get("action_latency", 0.0)
            found, lasts, error = plain_episode(
                given.robot, model, session, *start, command, *timing
            )
            count = counts.setdefault(row["cell"], np.zeros(4, int))
            same = len(found) == row["length"], (lasts and error <= most) == row["success"]
            count += [1, row["success"], all(same), np.array_equal(found, trace[1:])]
    for cell, count in counts.items():
        print("{}: {} episodes, {} succeed, {} the same, {} to the last bit".format(cell, *count))


if __name__ == "__main__":
    main()
