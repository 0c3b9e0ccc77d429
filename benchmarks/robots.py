"""What the measurements of published robots share: their files, and their episodes in a testbed."""

import argparse
import sys
import warnings
from pathlib import Path

import numpy as np
import onnxruntime

from integ_gym.envs.testbeds.making import find_testbed


def decisions(env, session, observation):
    """`info` after each decision of a testbed's episode."""
    ended = False
    while not ended:
        (action,) = session.run(None, {"obs": observation[None].astype(np.float32)})[0]
        observation, _, fallen, over, info = env.step(action)
        ended = fallen or over
        yield info


def robot_parser(title, episodes):
    parser = argparse.ArgumentParser(description=title.splitlines()[0])
    parser.add_argument("robot", help="module and class, as go1:Go1 of examples/robots")
    parser.add_argument("folder", help="of its files, the policy among them")
    parser.add_argument("--episodes", type=int, default=episodes)
    return parser


def open_robot(given):
    """Testbed, and a session of the policy on one core."""
    warnings.simplefilter("ignore")  # about meshes that only show
    root = Path(__file__).parents[1]
    sys.path += [str(root), str(Path.cwd())]
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    session = onnxruntime.InferenceSession(f"{given.folder}/policy.onnx", options)
    module = given.robot.partition(":")[0]
    known = (root / "examples" / "robots" / f"{module}.py").exists()
    named = f"examples.robots.{given.robot}" if known else given.robot
    return find_testbed(named, {"folder": given.folder}), session
