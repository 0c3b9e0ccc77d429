"""Read evidence with Polars: where did the energy of a swinging pendulum come from?

    python examples/read_evidence.py --lanes 256 --out runs/evidence_example

Records free swings on every integrator, one row per episode, then asks Parquet directly. Needs
`pip install polars`.
"""

from argparse import ArgumentParser
from pathlib import Path

import gymnasium as gym
import numpy as np
import polars as pl

import integ_gym

parser = ArgumentParser(description="Record episodes and read them with Polars.")
parser.add_argument("--lanes", type=int, default=256, help="episodes on each integrator")
parser.add_argument("--out", type=Path, default=Path("runs/evidence_example"))
INTEGRATORS = ("explicit_euler", "implicit_euler", "symplectic_euler", "rk4", "reference")


def record(integrator: str, lanes: int, store: integ_gym.EvidenceStore) -> None:
    context = integ_gym.EpisodeContext("free swings", integrator, policy_id="zero")
    env = gym.make_vec("IntegPendulum-v0", lanes, integrator=integrator, dt=0.05)
    env = integ_gym.RecordVectorEvidence(env, store, context, episodes=range(lanes))
    env.reset(seed=0)
    while not env.recorded.all():
        env.step(np.zeros(env.action_space.shape))
    env.close()


if __name__ == "__main__":
    given = parser.parse_args()
    for integrator in INTEGRATORS:
        record(integrator, given.lanes, integ_gym.EvidenceStore(given.out))
    rows = pl.scan_parquet(given.out / "*.parquet").group_by("integrator")
    numbers = pl.col("energy_start", "energy_residual_total", "energy_end").mean()
    print(rows.agg(pl.len(), numbers).sort("energy_end").collect())
