"""What people wait for before anything happens: whole processes, from their start to their end.

    python benchmarks/startup.py [--turns 7] [--only help import policy] [--json FILE]

help     `integ-gym --help` beside `python -c "import gymnasium"`
import   `import integ_gym` beside the same
policy   `integ-gym train --trainer fleet`, one policy of 300 000 decisions, with the programs that
         an earlier one compiled, beside what its training alone takes

Processes take turns, and a time is that of a fast one. Bytecode is kept, as where no variable says
otherwise.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

from bounds import print_judged
from measuring import results

GYMNASIUM = "import gymnasium"
PARTS = ("help", "import", "policy")
STEPS = 300_000
PACKAGES = ("integ-gym", "gymnasium", "numpy", "jax", "jaxlib")
_CLI = (sys.executable, "-m", "integ_gym.cli")


def seconds(command: Sequence[str], folder: str | None = None) -> float:
    """Wall time of a process.

    Raises:
        CalledProcessError: if it fails.
    """
    environ = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
    begun = time.perf_counter()
    subprocess.run(command, check=True, capture_output=True, cwd=folder, env=environ)
    return time.perf_counter() - begun


def fastest(commands: Mapping[str, Sequence[str]], turns: int) -> dict[str, float]:
    """Least wall time of commands that take turns, s; the first turn does not count."""
    found: dict[str, list[float]] = {name: [] for name in commands}
    for _ in range(turns + 1):
        for name, command in commands.items():
            found[name].append(seconds(command))
    return {name: min(times[1:]) for name, times in found.items()}


def policy_seconds(steps: int, turns: int) -> tuple[float, float]:
    """Of a fast process that trains one policy, and of its training alone."""
    train = ("train", "--trainer", "fleet", "--integrator", "rk4", "--dt", "0.05", "--no-progress")
    found = []
    with tempfile.TemporaryDirectory() as folder:
        command = (*_CLI, *train, "--total-steps", str(steps), "--out", "policy", "--force")
        for _ in range(turns + 1):
            whole = seconds(command, folder)
            card = json.loads((Path(folder) / "policy" / "policy.json").read_text("utf-8"))
            found.append((whole, float(card["wall_seconds"])))
    return min(found[1:])


def measure(parts: Sequence[str], turns: int, steps: int) -> dict[str, dict[str, float]]:
    """Seconds of each process, and the figures that bounds are about."""
    alone = {
        "gymnasium": (sys.executable, "-c", GYMNASIUM),
        "help": (*_CLI, "--help"),
        "import": (sys.executable, "-c", "import integ_gym"),
    }
    asked = {name: alone[name] for name in ("gymnasium", *parts) if name in alone}
    times = fastest(asked, turns) if len(asked) > 1 else {}
    figures = {n: s / times["gymnasium"] for n, s in times.items() if n != "gymnasium"}
    if "policy" in parts:
        whole, training = policy_seconds(steps, max(1, turns // 3))
        times |= {"policy": whole, "training of it": training}
        figures |= {"policy": whole, "policy over training": whole / training}
    return {"seconds": times, "figures": figures}


def main() -> None:
    """Print the tables; write JSON where asked."""
    parser = results.parser(__doc__, file=True)
    add = parser.add_argument
    add("--only", nargs="+", choices=PARTS, default=list(PARTS), metavar="PART")
    add("--turns", type=int, default=7, metavar="N", help="of each process (default: 7)")
    add("--steps", type=int, default=STEPS, metavar="N", help=f"decisions (default: {STEPS})")
    given = parser.parse_args()
    found = measure(given.only, given.turns, given.steps)
    results.print_table(
        ("process", "s"), [(name, f"{s:.2f}") for name, s in found["seconds"].items()]
    )
    print_judged("startup", found)
    results.write(given.json, found, PACKAGES)


if __name__ == "__main__":
    main()
