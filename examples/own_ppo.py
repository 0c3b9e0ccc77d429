"""PPO of your own with stable-baselines3, on a discretization that you choose.

    python examples/own_ppo.py --integrator explicit_euler --out runs/own_ppo

The policy is asked every 20 000 steps what it would do on other discretizations; at the end its
file gets a side-car that says what it was trained on. 2 minutes on one core.
"""

from argparse import ArgumentParser
from pathlib import Path

from stable_baselines3 import PPO
from stable_baselines3.common.env_util import make_vec_env

import integ_gym

parser = ArgumentParser(description="Train PPO on one discretization of the pendulum.")
parser.add_argument("--integrator", default="symplectic_euler")
parser.add_argument("--dt", type=float, default=0.05, help="integration step, s")
parser.add_argument("--total-steps", type=int, default=300_000)
parser.add_argument("--out", type=Path, default=Path("runs/own_ppo"))


if __name__ == "__main__":
    given = parser.parse_args()
    home = {"integrator": given.integrator, "dt": given.dt, "control_period": 0.05}
    task = {"start": "hanging", "max_torque": 0.8}
    envs = make_vec_env("IntegPendulum-v0", n_envs=16, seed=0, env_kwargs={**home, **task})
    model = PPO("MlpPolicy", envs, n_steps=256, batch_size=256, gamma=0.95, learning_rate=1e-3)
    model.learn(given.total_steps, callback=integ_gym.DiscretizationCallback(20_000, verbose=1))
    given.out.mkdir(parents=True, exist_ok=True)
    path = given.out / "policy.zip"
    model.save(path)
    integ_gym.write_sidecar(path, "IntegPendulum-v0", home=home, environment=task, seed=0)
    print(f"integ-gym evaluate {path} --env IntegPendulum-v0 --out {given.out}/judged")
