"""What each depth of `integ-gym evidence verify` costs, per 10 000 records.

    python benchmarks/verification_cost.py [--records 10000] [--integrator NAME] [--json FILE]

Records are episodes of random actions on the pendulum, 240 control steps each, in cells of 20
starts, all with traces. A depth holds those before it; its row is the time of all, on the clock and
of the processor, which other work on the machine does not change.
"""

from __future__ import annotations

import contextlib
import io
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import gymnasium as gym
from measuring import results

from integ_gym.cli import main as run_command
from integ_gym.evidence.labels import EpisodeContext
from integ_gym.evidence.sealing import seal
from integ_gym.evidence.store import EvidenceStore
from integ_gym.evidence.vector_recorder import RecordVectorEvidence
from integ_gym.train.baselines import make_baseline

ENVIRONMENT = "IntegPendulum-v0"
SETTINGS = {"dt": 0.05, "control_period": 0.05, "duration": 12.0}
STARTS = 20
"""Episodes of a policy in a cell."""

CELLS_PER_FILE = 25
PER = 10_000
PACKAGES = ("integ-gym", "gymnasium", "numpy", "pyarrow", "duckdb")

DEPTHS = {
    "whole": ["--depth", "whole"],
    "sealed": ["--depth", "sealed"],
    "replayed": ["--all"],
    "replayed, --policy": ["--all", "--policy"],
}


def fill_run(run: Path, records: int, integrator: str) -> int:
    """Record so many episodes, or a few more, and seal them; how many."""
    settings = {**SETTINGS, "integrator": integrator}
    env = gym.make_vec(ENVIRONMENT, num_envs=STARTS, **settings)
    policy = make_baseline("random", env.unwrapped.setup)
    env.close()
    store, cells = EvidenceStore(run / "evidence"), -(-records // STARTS)
    for first in range(0, cells, CELLS_PER_FILE):
        numbers = range(first, min(first + CELLS_PER_FILE, cells))
        store.commit_all(f"cells-{first:05d}", _tables(numbers, settings, policy))
    seal(run)
    return cells * STARTS


def _tables(cells: range, settings: dict[str, Any], policy: Any) -> Iterator[Any]:
    """Records of cells, each with starts of its own."""
    for cell in cells:
        context = EpisodeContext(
            "benchmark", f"cell {cell}", policy_id=policy.policy_id, policy_hash=policy.content_hash
        )
        env = RecordVectorEvidence(
            gym.make_vec(ENVIRONMENT, num_envs=STARTS, **settings), "", context,
            episodes=range(STARTS), commit_on_close=False,
        )  # fmt: skip
        observation, _ = env.reset(seed=[STARTS * cell + k for k in range(STARTS)])
        while not env.recorded.all():
            observation = env.step(policy.act(observation))[0]
        yield env.take()
        env.close()


def verification_times(run: Path, count: int) -> Iterator[dict[str, Any]]:
    """Seconds of each depth for `PER` records, on the clock and of the processor."""
    for depth, options in DEPTHS.items():
        command = ["evidence", "verify", str(run), "--no-progress", *options]
        wall, processor = time.perf_counter(), time.process_time()
        with contextlib.redirect_stdout(io.StringIO()) as printed:
            code = run_command(command)
        if code:
            raise SystemExit(f"{' '.join(command)} found problems:\n{printed.getvalue()}")
        yield {
            "depth": depth,
            "wall_s": PER / count * (time.perf_counter() - wall),
            "processor_s": PER / count * (time.process_time() - processor),
        }


def main() -> None:
    """Print the table; write JSON where asked."""
    parser = results.parser(__doc__, file=True)
    parser.add_argument("--records", type=int, default=PER, help="to be verified")
    parser.add_argument("--integrator", default="symplectic_euler", help="of the episodes")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as directory:
        count = fill_run(Path(directory), arguments.records, arguments.integrator)
        rows = list(verification_times(Path(directory), count))
    print(f"{count} records of {arguments.integrator}; seconds per {PER} records")
    cells = ((r["depth"], f"{r['wall_s']:.1f}", f"{r['processor_s']:.1f}") for r in rows)
    results.print_table(("depth", "clock", "processor"), cells)
    results.write(arguments.json, {"records": count, "depths": rows}, PACKAGES)


if __name__ == "__main__":
    main()
