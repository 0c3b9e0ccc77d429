"""Steps per second of the functional environments: one process per core, one thread each.

    python benchmarks/functional_throughput.py [--lanes 4096] [--steps 2000] [--json FILE]

Every step has observation, a linear policy on it, reward, energy ledger, and automatic reset;
compiling is not counted. XLA uses about one core per device, so all cores need several processes.
"""

from __future__ import annotations

import argparse
import json
import platform
import time
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from integ_gym.envs import functional
from integ_gym.envs.jax_ops import jax, jnp
from integ_gym.train.fleet import default_cache_dir, prepare_worker
from integ_gym.train.worker import Progress, cores

CASES = (
    ("IntegPendulum-v0", "symplectic_euler"),
    ("IntegPendulum-v0", "rk4"),
    ("IntegPendulum-v0", "implicit_midpoint"),
    ("IntegCartPole-v0", "explicit_euler"),
    ("IntegCartPole-v0", "rk4"),
)
GAINS = {
    "IntegPendulum-v0": (0.0, -6.0, -1.5),
    "IntegCartPole-v0": (0.3, 0.5, 8.0, 1.5),
}
REPEATS = 3


def rate(case: tuple[str, str], lanes: int, steps: int, start_at: float) -> dict[str, float]:
    """Steps per second of wall time and of processor time in this process; the best of some."""
    env_id, integrator = case
    env = functional.make(env_id, integrator=integrator)
    rollout = jax.jit(rollout_of(env, np.array(GAINS[env_id], np.float32), lanes, steps))
    jax.block_until_ready(rollout(jax.random.key(0), env.default_params))
    time.sleep(max(0.0, start_at - time.time()))
    best = {"wall": np.inf, "cpu": np.inf}
    for number in range(REPEATS):
        wall, cpu = time.perf_counter(), time.process_time()
        jax.block_until_ready(rollout(jax.random.key(number), env.default_params))
        best["wall"] = min(best["wall"], time.perf_counter() - wall)
        best["cpu"] = min(best["cpu"], time.process_time() - cpu)
    return {name: lanes * steps / seconds for name, seconds in best.items()}


def rollout_of(env: functional.FunctionalEnv, gains: np.ndarray, lanes: int, steps: int) -> Any:
    """A rollout as a function of key and parameters: mean return and mean ledger per lane."""
    discrete = env.setup.task.discrete is not None

    def step(carry: Any, key: Any, params: Any) -> Any:
        state, total = carry
        control = env.observation(state, params=params) @ gains
        action = (control > 0).astype(jnp.int32) if discrete else control[:, None]
        state, told = env.step(state, action, key, params)
        ledger = sum(told.info[n] for n in ("actuator_work", "dissipated", "energy_residual"))
        return (state, total + told.reward + ledger), told.truncated.sum()

    def rollout(key: Any, params: Any) -> Any:
        first = (env.initial(key, params, (lanes,)), jnp.zeros(lanes))
        keys = jax.random.split(key, steps)
        (_, total), ended = jax.lax.scan(lambda c, k: step(c, k, params), first, keys)
        return total.mean(), ended.sum()

    return rollout


def measure(lanes: int, steps: int) -> list[dict[str, Any]]:
    """One row per case: all processes together."""
    workers = cores()
    prepare = partial(prepare_worker, str(default_cache_dir()), False)
    rows = []
    with Progress().pool(workers, prepare) as pool:
        for case in CASES:
            start_at = time.time() + 20.0
            futures = [pool.submit(rate, case, lanes, steps, start_at) for _ in range(workers)]
            found = [future.result() for future in futures]
            rows.append(
                {
                    "environment": case[0],
                    "integrator": case[1],
                    "processes": workers,
                    "steps_per_second": sum(one["wall"] for one in found),
                    "steps_per_core_second": float(np.mean([one["cpu"] for one in found])),
                }
            )
    return rows


def main() -> None:
    """Print the table; write JSON where asked."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--lanes", type=int, default=4096, help="environments per process")
    parser.add_argument("--steps", type=int, default=2000, help="steps per rollout")
    parser.add_argument("--json", type=Path, help="also write the rows here")
    arguments = parser.parse_args()
    rows = measure(arguments.lanes, arguments.steps)
    print(f"{'environment':<20}{'integrator':<20}{'M steps/s':>10}{'M per core-s':>14}")
    for row in rows:
        total, per_core = row["steps_per_second"] / 1e6, row["steps_per_core_second"] / 1e6
        print(f"{row['environment']:<20}{row['integrator']:<20}{total:>10.1f}{per_core:>14.1f}")
    if arguments.json:
        versions = {name: version(name) for name in ("integ-gym", "jax", "jaxlib")}
        content = {"rows": rows, "versions": versions, "platform": platform.platform()}
        arguments.json.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
