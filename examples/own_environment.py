"""An environment of your own, judged: python examples/own_environment.py --out runs/windy."""

from argparse import ArgumentParser

import gymnasium as gym
from gymnasium.envs.classic_control import PendulumEnv

import integ_gym

parser = ArgumentParser(description="Judge a policy on an environment of one's own.")
parser.add_argument("--episodes", type=int, default=50, help="starts at every step")
parser.add_argument("--out", default="runs/windy")


class Windy(PendulumEnv):  # any gymnasium.Env will do; this one keeps its step in `dt`
    def step(self, action):
        return super().step(action + 0.5)  # N m


WINDY = gym.envs.registration.EnvSpec("Windy-v0", entry_point=Windy, max_episode_steps=200)


class Testbed(integ_gym.GymTestbed):  # what a panel needs to know of it
    home = integ_gym.Discretization("symplectic_euler", 0.05, 0.05, "gymnasium")
    choices = ("symplectic_euler",)

    def build(self, discretization):
        env = gym.make(WINDY)
        env.unwrapped.dt = discretization.dt
        return self.held(env, discretization, rewards="rate")

    def read(self, env):
        return self.as_applied("symplectic_euler", env.unwrapped.dt, env)


if __name__ == "__main__":
    given = vars(parser.parse_args())
    policy, home = (lambda seen: [2.0 if seen[2] > 0.0 else -2.0]), Testbed.home.arguments()
    panel = integ_gym.evaluate(policy, "own_environment:Testbed", home=home, workers=1, **given)
    print(*(f"{e.returns.estimate:8.1f}  {e.row} on {e.cell}" for e in panel.matrix), sep="\n")
