"""Three cells and three losses with their intervals, from the published rows alone.

    python benchmarks/tables/read_learned_engines.py docs/tables/learned_engines

It imports nothing of integ-gym. The first loss is in the page's table of tests. The others are in
no table: without the engine in which no policy learned, and among engines without hidden terms.
"""

import sys
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq

rows = pq.read_table(Path(sys.argv[1]) / "rows.parquet").to_pylist()
rows = [row for row in rows if row["task"] == "swing-up"]
engines = sorted({row["trained_on"] for row in rows})


def rates(arm: str, trained_on: str, judged_on: str) -> np.ndarray:
    """Success of each seed's policy, in the order of seeds."""
    wanted = {"arm": arm, "trained_on": trained_on, "judged_on": judged_on}
    found = [row for row in rows if all(row[name] == value for name, value in wanted.items())]
    found.sort(key=lambda row: row["run"])
    return np.array([row["successes"] / row["starts"] for row in found])


def print_loss(what: str, arm: str, among: list[str]) -> None:
    """Mean over engines of success at home minus that in the others; with its interval."""
    lost = np.mean(
        [
            rates(arm, home, home)
            - np.mean([rates(arm, home, away) for away in among if away != home], axis=0)
            for home in among
        ],
        axis=0,
    )
    low, high = interval(lost)
    print(f"{what}: {lost.mean():.2f} ({low:.2f} to {high:.2f})")


def interval(differences: np.ndarray) -> np.ndarray:
    """95 % of the posterior of a mean under a Dirichlet process (Ferguson 1973).

    Differences of seeds have weight 1; -1, 0, 0 and 1, which nobody saw, have weight 1/4 each.
    """
    values = np.concatenate([differences, (-1.0, 0.0, 0.0, 1.0)])
    shapes = np.concatenate([np.ones(len(differences)), np.full(4, 0.25)])
    weights = np.random.default_rng(0).gamma(shapes, size=(200_000, len(values)))
    return np.quantile(weights @ values / weights.sum(axis=1), (0.025, 0.975))


for cell in (
    ("as got", "native", "native"),
    ("as got", "native", "pybullet"),
    ("matched", "native", "pybullet"),
):
    own = rates(*cell)
    print(f"{cell[0]}, from {cell[1]} to {cell[2]}: {own.mean():.2f} ({len(own)} seeds)")
print_loss("lost as got", "as got", engines)
print_loss("lost as got, without sapien", "as got", [name for name in engines if name != "sapien"])
plain = [name for name in engines if name not in ("pybullet", "sapien")]
print_loss(f"lost as got, among {', '.join(plain)}", "as got", plain)
