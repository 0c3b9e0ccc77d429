"""A whole panel from Python: train on two discretizations, judge on all, read the verdicts.

    python examples/panel_from_python.py --total-steps 300000 --seeds 10

Ten seeds take about 3 minutes on 2 cores. Run it again with more seeds: what is finished stays.
"""

from argparse import ArgumentParser
from pathlib import Path

import integ_gym

parser = ArgumentParser(description="Run a small panel.")
parser.add_argument("--total-steps", type=int, default=300_000, help="decisions of each policy")
parser.add_argument("--seeds", type=int, default=10, help="policies of each row")
parser.add_argument("--out", type=Path, default=Path("runs/panel_from_python"))

SPEC = """
name = "two homes"
question = "Does what is learned on Gymnasium's map hold on the truth?"
env_id = "IntegPendulum-v0"
control_period = 0.05
episodes = 20
seeds = {seeds}
environment = {{ start = "hanging", max_torque = 0.7, duration = 12.0 }}
training = {{ total_steps = {total_steps} }}
train = [{{ integrator = ["symplectic_euler", "rk4"], dt = 0.05 }}]
evaluate = [{{ integrator = ["symplectic_euler", "rk4"], dt = [0.05, 0.025, 0.0125] }}]
family = [["symplectic_euler dt=0.05", "reference dt=0.05"]]
"""

if __name__ == "__main__":
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    spec = given.out.with_suffix(".toml")
    spec.write_text(SPEC.format(seeds=list(range(given.seeds)), total_steps=given.total_steps))
    panel = integ_gym.run_panel(spec, given.out)
    for verdict in panel.verdicts:
        print(f"{verdict.row} → {verdict.cell}: {verdict.verdict}")
    print(f"{panel.answer}\nPage: {given.out}/report.html")
