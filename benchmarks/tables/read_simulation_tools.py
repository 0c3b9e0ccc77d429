"""Three cells and one interval, from the published rows alone.

    python benchmarks/tables/read_simulation_tools.py docs/tables/simulation_tools

It imports nothing of integ-gym. The interval of a median of six is that between the least and the
greatest, which covers it with a probability of 1 - 2 / 2^6, about 0.97.
"""

import sys
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq

rows = pq.read_table(Path(sys.argv[1]) / "rows.parquet").to_pylist()


def values(
    block: str, engine: str, integrator: str, quantity: str, dt: float = 0.002
) -> np.ndarray:
    """Of all starts."""
    wanted = {"block": block, "engine": engine, "integrator": integrator, "quantity": quantity}
    wanted["dt"] = dt
    return np.array(
        [row["value"] for row in rows if all(row[name] == value for name, value in wanted.items())]
    )


TRUTH, OWN = "from the truth", "from its finest step"
for cell in (
    ("chain-5", "mujoco", "Euler", TRUTH),
    ("chain-5", "mujoco", "RK4", "energy"),
    ("box", "mujoco", "RK4", OWN),
):
    found = values(*cell)
    print(f"{', '.join(cell)}: {np.median(found):.1e} ({len(found)} starts)")
found = values("box", "mujoco", "RK4", TRUTH)
assert len(found) == 6
print(f"box, mujoco, RK4, {TRUTH}: {np.median(found):.1e} ({found.min():.1e}–{found.max():.1e})")
