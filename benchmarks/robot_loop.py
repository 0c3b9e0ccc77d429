"""Published robots in a loop of MuJoCo and onnxruntime alone, beside a testbed's episodes.

``python benchmarks/robot_loop.py go1:Go1 DIR``, with its files and its ``policy.onnx`` in DIR.
"""

import mujoco
import numpy as np
from robot_plain import load_model, plain_episode
from robots import decisions, open_robot, robot_parser

from integ_gym import Discretization


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
            expected, lasts, _ = plain_episode(name, own, session, *start)
            succeeded += lasts
            equal += np.array_equal(expected, states) and lasts >= success
        print(f"{integrator} iterations={iterations}: {succeeded} succeed, {equal} equal")


if __name__ == "__main__":
    main()
