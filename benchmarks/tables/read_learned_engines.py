"""Three cells of each task and its losses with their intervals, from the published rows alone.

    python benchmarks/tables/read_learned_engines.py docs/tables/learned_engines

It imports nothing of integ-gym. The first loss of a task is in the page's table of tests. The
others are in no table: without SAPIEN, in which no policy learned the swing-up, and among engines
that damp and rub nothing unasked, with native and without.
"""

import sys
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq

HIDDEN_TERMS = ("pybullet", "sapien")
rows = pq.read_table(Path(sys.argv[1]) / "rows.parquet").to_pylist()


def rates(task: str, arm: str, trained_on: str, judged_on: str) -> np.ndarray:
    """Success of each seed's policy, in the order of seeds."""
    wanted = {"task": task, "arm": arm, "trained_on": trained_on, "judged_on": judged_on}
    found = [row for row in rows if all(row[name] == value for name, value in wanted.items())]
    found.sort(key=lambda row: row["run"])
    return np.array([row["successes"] / row["starts"] for row in found])


def print_loss(what: str, task: str, among: list[str]) -> None:
    """Mean over engines as got of success at home minus that in the others; with its interval."""
    if not all(len(rates(task, "as got", home, home)) for home in among):
        print(f"{task}, {what}: not run for all engines")
        return
    lost = np.mean(
        [
            rates(task, "as got", home, home)
            - np.mean([rates(task, "as got", home, away) for away in among if away != home], axis=0)
            for home in among
        ],
        axis=0,
    )
    low, high = interval(lost)
    print(f"{task}, {what}: {lost.mean():.2f} ({low:.2f} to {high:.2f})")


def interval(differences: np.ndarray) -> np.ndarray:
    """95 % of the posterior of a mean under a Dirichlet process (Ferguson 1973).

    Differences of seeds have weight 1; -1, 0, 0 and 1, which nobody saw, have weight 1/4 each.
    """
    values = np.concatenate([differences, (-1.0, 0.0, 0.0, 1.0)])
    shapes = np.concatenate([np.ones(len(differences)), np.full(4, 0.25)])
    weights = np.random.default_rng(0).gamma(shapes, size=(200_000, len(values)))
    return np.quantile(weights @ values / weights.sum(axis=1), (0.025, 0.975))


for task in sorted({row["task"] for row in rows}, reverse=True):
    for arm, home, away in (
        ("as got", "native", "native"),
        ("as got", "native", "pybullet"),
        ("matched", "native", "pybullet"),
    ):
        if len(own := rates(task, arm, home, away)):
            print(f"{task}, {arm}, from {home} to {away}: {own.mean():.3f} ({len(own)} seeds)")
    engines = sorted({row["trained_on"] for row in rows if row["task"] == task})
    plain = [name for name in engines if name not in HIDDEN_TERMS]
    others = [name for name in plain if name != "native"]
    print_loss("lost as got", task, engines)
    print_loss("lost as got, without sapien", task, [one for one in engines if one != "sapien"])
    print_loss(f"lost as got, among {', '.join(plain)}", task, plain)
    print_loss(f"lost as got, among {', '.join(others)}", task, others)
