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
    parser.add_argument("robot", help="module and class in examples/robots, as go1:Go1")
    parser.add_argument("folder", help="of its files, the policy among them")
    parser.add_argument("--episodes", type=int, default=episodes)
    return parser


def open_robot(given):
    """Testbed, and a session of the policy on one core."""
    warnings.simplefilter("ignore")  # about meshes that only show
    sys.path.append(str(Path(__file__).parents[1]))
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    session = onnxruntime.InferenceSession(f"{given.folder}/policy.onnx", options)
    return find_testbed(f"examples.robots.{given.robot}", {"folder": given.folder}), session
