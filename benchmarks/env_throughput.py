"""Steps per second of single and vector environments beside Gymnasium's own, in one run.

    python benchmarks/env_throughput.py [--seconds 1.0] [--json FILE]

Random actions, drawn before the clock starts; resets included. Ratios are against Gymnasium's
environment of the same kind in the same run.
"""

from __future__ import annotations

import argparse
import json
import platform
import tempfile
import time
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any

import gymnasium as gym

import integ_gym  # noqa: F401
from integ_gym.evidence import EpisodeContext, RecordEvidence

ACTIONS = 256
LANES = (64, 1024)
INTEGRATORS = ("symplectic_euler", "rk4", "implicit_midpoint", "reference")


def single_rate(environment: gym.Env[Any, Any], seconds: float) -> float:
    """Control steps per second of one environment."""
    environment.action_space.seed(0)
    actions = [environment.action_space.sample() for _ in range(ACTIONS)]
    environment.reset(seed=0)

    def advance() -> int:
        for action in actions:
            _, _, terminated, truncated, _ = environment.step(action)
            if terminated or truncated:
                environment.reset()
        return ACTIONS

    return _rate(advance, seconds)


def vector_rate(environment: Any, seconds: float) -> float:
    """Control steps per second, summed over lanes."""
    environment.action_space.seed(0)
    actions = [environment.action_space.sample() for _ in range(16)]
    environment.reset(seed=0)

    def advance() -> int:
        for action in actions:
            environment.step(action)
        return len(actions) * int(environment.num_envs)

    return _rate(advance, seconds)


def _rate(advance: Callable[[], int], seconds: float) -> float:
    advance()
    steps, start = 0, time.perf_counter()
    while time.perf_counter() - start < seconds:
        steps += advance()
    return steps / (time.perf_counter() - start)


def measure(seconds: float) -> list[dict[str, Any]]:
    """One row per environment: name, lanes, steps/s and the ratio to Gymnasium's."""
    rows = []
    for ours, stock in (("IntegPendulum-v0", "Pendulum-v1"), ("IntegCartPole-v0", "CartPole-v1")):
        base = single_rate(gym.make(stock), seconds)
        rows.append(_row(stock, 1, base, base))
        rows.append(_row(ours, 1, single_rate(gym.make(ours), seconds), base))
        with tempfile.TemporaryDirectory() as store:
            context = EpisodeContext("benchmark", "single")
            recorded = RecordEvidence(gym.make(ours), store, context, commit_on_close=False)
            rows.append(_row(f"{ours} with evidence", 1, single_rate(recorded, seconds), base))
        for lanes in LANES:
            base = vector_rate(gym.make_vec(stock, num_envs=lanes), seconds)
            rows.append(_row(stock, lanes, base, base))
            for integrator in INTEGRATORS:
                environment = gym.make_vec(ours, num_envs=lanes, integrator=integrator)
                name = f"{ours} {integrator}"
                rows.append(_row(name, lanes, vector_rate(environment, seconds), base))
    return rows


def _row(name: str, lanes: int, rate: float, base: float) -> dict[str, Any]:
    return {"environment": name, "lanes": lanes, "steps_per_second": rate, "ratio": rate / base}


def main() -> None:
    """Print the table; write JSON where asked."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=1.0, help="time per row, s")
    parser.add_argument("--json", type=Path, help="also write the rows here")
    arguments = parser.parse_args()
    rows = measure(arguments.seconds)
    print(f"{'environment':<40}{'lanes':>7}{'steps/s':>14}{'ratio':>8}")
    for row in rows:
        rate, ratio = row["steps_per_second"], row["ratio"]
        print(f"{row['environment']:<40}{row['lanes']:>7}{rate:>14,.0f}{ratio:>8.2f}")
    if arguments.json:
        versions = {name: version(name) for name in ("integ-gym", "gymnasium", "numpy")}
        content = {"rows": rows, "versions": versions, "platform": platform.platform()}
        arguments.json.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
