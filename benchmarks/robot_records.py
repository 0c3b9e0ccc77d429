"""Records of a published robot beside a loop of MuJoCo, NumPy and onnxruntime alone.

``python benchmarks/robot_records.py go1 DIR RUN``: the robot's files and its ``policy.onnx`` are in
DIR, RUN is of ``integ-gym evaluate``, read by pyarrow. Each episode of the policy is run again from
its start, under its command, but for late observations and other versions of MuJoCo. The processor
time is that of this loop, of an episode of 10 s.
"""

import argparse
import json
import time
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
    parser.add_argument("--episodes", type=int, default=100, help="of each cell")
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
            count = counts.setdefault(row["cell"], np.zeros(6))
            if count[0] == given.episodes:
                continue
            settle(model, own)
            trace = np.array([row[name] for name in states]).T
            start, command = np.split(trace[0], [model.nq]), [row[name][0] for name in commands]
            timing = own["control_period"], own.get("action_latency", 0.0)
            begin = time.process_time()
            found, lasts, error = plain_episode(
                given.robot, model, session, *start, command, *timing
            )
            spent = time.process_time() - begin
            same = len(found) == row["length"], (lasts and error <= most) == row["success"]
            equal = np.array_equal(found, trace[1:])
            count += [1, row["success"], all(same), equal, len(found) * timing[0], spent]
    words = "{}: {:.0f} episodes, {:.0f} succeed, {:.0f} the same, {:.0f} to the last bit"
    for cell, (*count, seconds, spent) in counts.items():
        print(words.format(cell, *count), f"{1e4 * spent / seconds:.0f} ms", sep=", ")


if __name__ == "__main__":
    main()
