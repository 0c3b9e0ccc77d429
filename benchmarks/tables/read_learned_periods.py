"""Three cells, one difference and its interval, from the published rows alone.

    python benchmarks/tables/read_learned_periods.py docs/tables/learned_periods

It imports nothing of integ-gym: rates are means over seeds, the interval of the difference is a
bootstrap over seeds (Efron and Tibshirani 1993, percentile), so it is close to the page's and not
equal.
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
draws = np.random.default_rng(0).integers(len(home), size=(10_000, len(home)))
low, high = np.quantile((home - away)[draws].mean(axis=1), (0.025, 0.975))
print(f"lost at the longest period: {(home - away).mean():.2f} ({low:.2f} to {high:.2f})")
