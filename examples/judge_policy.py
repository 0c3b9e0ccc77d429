"""Judge a policy of your own on every integrator, at three steps, and on the truth.

    python examples/judge_policy.py --out runs/judged

It pumps energy, then holds. Any function, or a model of stable-baselines3 or its file, will do.
"""

from argparse import ArgumentParser
from math import atan2

import integ_gym

parser = ArgumentParser(description="Judge a hand-made policy for the pendulum.")
parser.add_argument("--episodes", type=int, default=50, help="starts in every discretization")
parser.add_argument("--out", default="runs/judged")


def policy(observation):
    """Torque in N m from (cos θ, sin θ, θ̇)."""
    cosine, sine, speed = (float(x) for x in observation)
    missing = 10.0 - (speed**2 / 6.0 + 5.0 * (1.0 + cosine))  # energy upright minus energy now, J
    if cosine > 0.95 and abs(missing) < 1.0:
        return [-12.0 * atan2(sine, cosine) - 3.0 * speed]
    return [0.8 if missing * speed >= 0.0 else -0.8]


if __name__ == "__main__":
    given = parser.parse_args()
    panel = integ_gym.evaluate(
        policy, "IntegPendulum-v0", given.out, home="integrator=reference,dt=0.05",
        episodes=given.episodes, environment={"start": "hanging", "max_torque": 0.8}, workers=1,
    )  # fmt: skip
    given_rows = [row.name for row in panel.rows if row.kind == "given"]
    for entry in panel.matrix:
        if entry.row in given_rows:
            print(f"{entry.success.estimate:4.0%}  {entry.cell}")
    print(f"{panel.answer}\nPage: {given.out}/report.html")
