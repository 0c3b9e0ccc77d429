"""Three cells, one difference and its interval, from the published rows alone.

    python benchmarks/tables/read_learned_periods.py docs/tables/learned_periods

It imports nothing of integ-gym. Rates are means over seeds. The interval is that of the page's
table of tests: 95 % of the posterior of a mean under a Dirichlet process (Ferguson 1973), in which
differences of seeds have weight 1, and -1, 0, 0 and 1, which nobody saw, 1/4 each.
"""

import sys
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq

rows = pq.read_table(Path(sys.argv[1]) / "rows.parquet").to_pylist()


def rates(task: str, arm: str, trained_at: float, judged_at: float, delay: int = 0) -> np.ndarray:
    """Success of each seed's PPO policy."""
    wanted = {"task": task, "algorithm": "PPO", "arm": arm, "trained_at": trained_at}
    wanted |= {"judged_at": judged_at, "delay": delay}
    found = [row for row in rows if all(row[name] == value for name, value in wanted.items())]
    found.sort(key=lambda row: row["seed"])
    return np.array([row["successes"] / row["starts"] for row in found])


cells = {
    "tuned, judged there": ("cart-pole", "both", 0.02, 0.02),
    "per decision at the longest period": ("cart-pole", "per decision", 0.08, 0.08),
    "per second at the shortest period": ("cart-pole", "per second", 0.005, 0.005),
}
for name, cell in cells.items():
    own = rates(*cell)
    print(f"{name}: {own.mean():.2f} ({len(own)} seeds)")
home, away = rates("cart-pole", "both", 0.02, 0.02), rates("cart-pole", "both", 0.02, 0.08)
lost = home - away
values = np.concatenate([lost, (-1.0, 0.0, 0.0, 1.0)])
shapes = np.concatenate([np.ones(len(lost)), np.full(4, 0.25)])
weights = np.random.default_rng(0).gamma(shapes, size=(200_000, len(values)))
low, high = np.quantile(weights @ values / weights.sum(axis=1), (0.025, 0.975))
print(f"lost at the longest period: {lost.mean():.2f} ({low:.2f} to {high:.2f})")
