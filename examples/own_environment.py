"""An environment of your own, judged: python examples/own_environment.py --out runs/windy."""

from argparse import ArgumentParser

import gymnasium as gym

import integ_gym

parser = ArgumentParser(description="Judge a policy on an environment of one's own.")
parser.add_argument("--episodes", type=int, default=50, help="starts at every step")
parser.add_argument("--out", default="runs/windy")


class Testbed(integ_gym.GymTestbed):  # what a panel needs to know of an environment
    home = integ_gym.Discretization("symplectic_euler", 0.05, 0.05, "gymnasium")
    choices = ("symplectic_euler",)

    def build(self, discretization):
        env = gym.make("Pendulum-v1")  # any gymnasium.Env will do whose step can be set
        env = gym.wrappers.TransformAction(env, lambda torque: torque + 0.5, None)  # wind, N m
        env.unwrapped.dt = discretization.dt
        return self.held(env, discretization, rewards="rate")

    def read(self, env):
        return self.as_applied("symplectic_euler", env.unwrapped.dt, env)


def swing_up(seen):  # pumps energy in until there are 5 J, then balances
    cos, sin, speed = seen
    pump = 2.0 if (speed > 0.0) == (speed**2 / 6.0 + 5.0 * cos < 5.0) else -2.0
    return [-12.0 * sin - 3.0 * speed - 0.5 if cos > 0.9 else pump]


if __name__ == "__main__":
    given, home = vars(parser.parse_args()), Testbed.home.arguments()
    panel = integ_gym.evaluate(swing_up, "own_environment:Testbed", home=home, workers=1, **given)
    print(f"{panel.answer}\nPage: {given['out']}/report.html")
