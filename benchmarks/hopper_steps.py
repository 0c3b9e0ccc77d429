"""What a step makes of a hopper: Raibert's controller from the same starts at many steps.

    python benchmarks/hopper_steps.py [--episodes 50] [--json FILE]

``IntegHopper-v0``, decided every 20 ms, from starts of seeds 100 and on: the share that succeeds,
the share that falls, and the mean speed where 1 m/s is commanded.
"""

from __future__ import annotations

import gymnasium as gym
import numpy as np
from measuring import results

from integ_gym.envs.environment import environment_setup
from integ_gym.envs.registries import TRUTH
from integ_gym.train.baselines import make_baseline

ENV = "IntegHopper-v0"
PERIOD = 0.02
SEED = 100
CELLS = (
    (TRUTH, PERIOD),
    *(("rk4", dt) for dt in (0.002, 0.004, 0.005, 0.01)),
    *(("explicit_euler", dt) for dt in (0.0005, 0.002, 0.005)),
    *(("symplectic_euler", dt) for dt in (0.001, 0.002, 0.004, 0.005)),
    *(("stormer_verlet", dt) for dt in (0.002, 0.004)),
    *(("implicit_euler", dt) for dt in (0.002, 0.005, 0.01, 0.02)),
    *(("implicit_midpoint", dt) for dt in (0.005, 0.01, 0.02)),
)


def hop(integrator: str, dt: float, episodes: int) -> tuple[float, float, float]:
    """Shares that succeed and fall, and the mean speed over an episode's time, m/s."""
    arguments = {"integrator": integrator, "dt": dt, "control_period": PERIOD}
    setup = environment_setup(ENV, arguments)
    policy = make_baseline("handmade", setup)
    envs = gym.make_vec(ENV, num_envs=episodes, compiled=True, **arguments)
    observations, _ = envs.reset(seed=SEED)
    running, success = np.ones(episodes, dtype=bool), np.zeros(episodes, dtype=bool)
    fallen, distance = np.zeros(episodes, dtype=bool), np.zeros(episodes)
    for _ in range(setup.timing.horizon):
        observations, _, terminated, _, info = envs.step(policy.act(observations))
        success |= running & info["success"]
        fallen |= running & terminated
        running &= ~terminated
        distance[running] = envs.unwrapped.state[running, 0]
    envs.close()
    speed = distance.mean() / (setup.timing.horizon * PERIOD)
    return float(success.mean()), float(fallen.mean()), float(speed)


def main() -> None:
    parser = results.parser(__doc__, file=True)
    parser.add_argument("--episodes", type=int, default=50, metavar="N", help="starts of each cell")
    given = parser.parse_args()
    found = []
    print(f"{'integrator':<18} {'dt, s':>7}  succeed  fall  speed, m/s")
    for integrator, dt in CELLS:
        success, fallen, speed = hop(integrator, dt, given.episodes)
        print(f"{integrator:<18} {dt:7g}  {success:7.2f}  {fallen:4.2f}  {speed:10.2f}", flush=True)
        found.append([integrator, dt, success, fallen, speed])
    results.write(given.json, {"cells": found}, ("integ-gym", "numpy"))


if __name__ == "__main__":
    main()
