"""What a panel's training costs: the fleet beside stable-baselines3 in one run.

    python benchmarks/panel_cost.py [--only panel single policies steps acting share]
                                    [--json FILE]

panel      policies per minute with evidence, process start included, compilation included and with
           the programs of the run before, against one process of stable-baselines3 and against one
           per core, at equal settings; their clocks start when they have trained for one rollout
single     one policy on one core, compilation excluded
policies   growth over 1, 2, 4 … 64 policies on one core, with memory
steps      growth over dt, dt/2 and dt/4 at a fixed control period
acting     growth of the environments' part alone, over dt to dt/64
share      of the measured peak of small float32 matrix products that updates reach, and what
           takes the rest of the time

`panel` and `single` compare wall times: run them on an idle machine. The others count processor
time.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import Any

from bounds import print_judged
from measuring import results, training_cost
from tqdm import tqdm

from integ_gym.support.processes import cores
from integ_gym.train.fleet.planning import kind_of
from integ_gym.train.fleet.worker import GIB_PER_WORKER
from integ_gym.train.ppo import PPOConfig

EXAMPLES = """\
examples:
  python benchmarks/panel_cost.py --json cost.json       everything; 8 minutes on 2 idle cores
  python benchmarks/panel_cost.py --only share policies  two parts of it
  python benchmarks/panel_cost.py --policies 8 --steps 20000
                                                         a quick look
"""

SETTINGS: dict[str, Any] = {
    "env_arguments": {"integrator": "rk4", "dt": 0.05, "control_period": 0.05},
    "n_envs": 4,
    "n_steps": 1024,
    "batch_size": 64,
    "n_epochs": 10,
}
GROWTH = (1, 2, 4, 8, 16, 32, 64)
DIVISIONS = (1, 2, 4)
FINE_DIVISIONS = (1, 2, 4, 8, 16, 32, 64)
INTEGRATORS = ("symplectic_euler", "rk4", "implicit_midpoint")
TOGETHER = 8
"""Policies of a chunk where their number is not what is varied."""

PACKAGES = ("integ-gym", "jax", "jaxlib", "stable-baselines3", "torch", "numpy")

Rows = list[list[str]]


class Costs:
    """The measurements, each made once.

    Args:
        policies: of the panel.
        steps: decisions of each.
        runs: of stable-baselines3 in each process.
    """

    def __init__(self, policies: int, steps: int, runs: int) -> None:
        self.bar = tqdm(unit=" measurements")
        self.config = PPOConfig.of("IntegPendulum-v0", total_steps=steps, **SETTINGS)
        self.period = self.config.env_arguments["control_period"]
        self.rollouts = self.config.rounded_steps // self.config.rollout
        self.policies = policies
        self.runs = runs

    def seeds(self, count: int, **arguments: Any) -> list[PPOConfig]:
        """Runs that differ in their seed, with some of the environment's arguments replaced."""
        given = {**self.config.env_arguments, **arguments}
        return [replace(self.config, seed=seed, env_arguments=given) for seed in range(count)]

    def measured(self, measure: Callable[..., Any], *arguments: Any) -> Any:
        """What ``measure`` gives."""
        found = measure(*arguments)
        self.bar.update()
        return found

    def alone(self, measure: Callable[..., Any], *arguments: Any) -> Any:
        """What ``measure`` gives in a process of its own."""
        return self.measured(training_cost.in_one_process, measure, *arguments)

    @cached_property
    def sb3(self) -> float:
        """One process of stable-baselines3, s per policy."""
        seconds = self.measured(training_cost.sb3_seconds, self.config, 1, self.runs)
        return float(seconds) / self.runs

    def panel(self) -> tuple[dict[str, Any], Rows]:
        """The whole panel."""
        runs = self.seeds(self.policies)
        with tempfile.TemporaryDirectory() as cache:
            given = runs, cores(), Path(cache)
            first, again = (self.measured(training_cost.fleet_seconds, *given) for _ in range(2))
        fleet, compiled = (found["seconds"] / self.policies for found in (first, again))
        beside = self.measured(training_cost.sb3_seconds, self.config, cores(), self.runs)
        beside /= self.runs * cores()
        content = {
            "policies": self.policies,
            "seconds_per_policy": {
                "fleet": fleet,
                "fleet, compiled before": compiled,
                "sb3": self.sb3,
                "sb3 per core": beside,
            },
            "worker_mib": first["worker_mib"],
            "budget_mib": 1024.0 * GIB_PER_WORKER["cpu"],
        }
        rows = [
            _rate(f"fleet, {cores()} processes, {self.policies} policies", fleet),
            _rate("the same with programs of the run before", compiled),
            _rate("sb3, one process", self.sb3, self.sb3 / fleet, self.sb3 / compiled),
            _rate(f"sb3, {cores()} processes", beside, beside / fleet, beside / compiled),
        ]
        return content, rows

    def single(self) -> tuple[dict[str, Any], Rows]:
        """One policy on one core."""
        found = self.alone(training_cost.rollout_cost, self.seeds(1))
        fleet = self.rollouts * found["wall"]
        content = {"seconds": {"fleet": fleet, "sb3": self.sb3}}
        rows = [
            _rate("fleet, one policy on one core", fleet),
            _rate("sb3, one process", self.sb3, self.sb3 / fleet),
        ]
        return content, rows

    def growth(self) -> tuple[list[dict[str, float]], Rows]:
        """Cost over the number of policies."""
        found = []
        for count in GROWTH:
            cost = self.alone(training_cost.relative_cost, self.seeds(count), self.seeds(1))
            found.append({"policies": count, **cost})
        return found, [self._row(f"{r['policies']} policies", r, r["policies"]) for r in found]

    def steps(self) -> tuple[list[dict[str, Any]], Rows]:
        """Cost over the integration step."""
        found: list[dict[str, Any]] = []
        for integrator, division in product(INTEGRATORS, DIVISIONS):
            coarse, runs = (
                self.seeds(TOGETHER, integrator=integrator, dt=self.period / parts)
                for parts in (1, division)
            )
            cost = self.alone(training_cost.relative_cost, runs, coarse)
            found.append({"integrator": integrator, "dt": self.period / division, **cost})
        rows = [self._row(f"{r['integrator']} dt={r['dt']:g}", r, TOGETHER) for r in found]
        return found, rows

    def _row(self, name: str, found: Mapping[str, Any], policies: float) -> list[str]:
        """One line of a table; ``policies`` were trained together."""
        cpu = self.rollouts * found["cpu"] / policies
        return [name, f"{cpu:.2f}", f"{found['ratio']:.2f}", f"{found['mib']:.0f}"]

    def acting(self) -> tuple[list[dict[str, Any]], Rows]:
        """Cost of the environments alone over the integration step."""
        found: list[dict[str, Any]] = []
        rows, decisions = [], TOGETHER * self.config.rollout
        for integrator, division in product(INTEGRATORS, FINE_DIVISIONS):
            dt, more = self.period / division, ""
            runs = self.seeds(TOGETHER, integrator=integrator, dt=dt)
            seconds = self.alone(training_cost.acting_seconds, runs)
            if division > 1:
                steps = decisions * (division - round(self.period / found[-1]["dt"]))
                more = f"{1e6 * (seconds - found[-1]['seconds']) / steps:.3f}"
            found.append({"integrator": integrator, "dt": dt, "seconds": seconds})
            rows.append([f"{integrator} dt={dt:g}", f"{1e6 * seconds / decisions:.3f}", more])
        return found, rows

    def share(self) -> tuple[dict[str, Any], Rows]:
        """Share of the peak, and what takes the rest."""
        runs = self.seeds(TOGETHER)
        peak = self.alone(training_cost.small_matrix_peak)
        parts = self.alone(training_cost.part_seconds, runs)
        whole = self.alone(training_cost.rollout_cost, runs)["cpu"]
        sizes = (*kind_of(self.config).sizes, 1)
        arithmetic = TOGETHER * training_cost.update_flops(self.config, sizes) / peak
        parts["evidence and bookkeeping"] = max(0.0, whole - sum(parts.values()))
        shown = {"updates: matrix products at the peak": arithmetic}
        shown["updates: all else"] = parts["updates"] - arithmetic
        shown |= {name: seconds for name, seconds in parts.items() if name != "updates"}
        content = {
            "peak_flops": peak,
            "share_of_updates": arithmetic / parts["updates"],
            "share_of_all": arithmetic / whole,
            "seconds": shown,
        }
        scale = self.rollouts / TOGETHER
        rows = [[name, f"{scale * s:.3f}", f"{s / whole:.0%}"] for name, s in shown.items()]
        rows.append([f"all, at a peak of {peak / 1e9:.0f} GFLOP/s", f"{scale * whole:.3f}", "100%"])
        return content, rows


PARTS: Mapping[str, tuple[Callable[[Costs], tuple[Any, Rows]], Sequence[str]]] = {
    "panel": (Costs.panel, ("panel", "s per policy", "policies/min", "fleet is")),
    "single": (Costs.single, ("single", "s per policy", "policies/min", "fleet is")),
    "policies": (Costs.growth, ("policies", "s per policy", "cost / one's", "MiB")),
    "steps": (Costs.steps, ("steps", "s per policy", "cost / dt", "MiB")),
    "acting": (Costs.acting, ("acting", "us per decision", "us per step more")),
    "share": (Costs.share, ("share", "s per policy", "of all")),
}


def _rate(name: str, seconds: float, *ratios: float) -> list[str]:
    speedup = f"{' and '.join(f'{ratio:.1f}' for ratio in ratios)} times" if ratios else ""
    return [name, f"{seconds:.2f}", f"{60.0 / seconds:.1f}", speedup]


def main() -> None:
    """Print the tables; write JSON where asked."""
    parser = results.parser(__doc__, EXAMPLES, file=True)
    add = parser.add_argument
    add("--only", nargs="+", choices=list(PARTS), default=list(PARTS), metavar="PART")
    add("--policies", type=int, default=40, metavar="N", help="of the panel (default: 40)")
    add("--steps", type=int, default=100_000, metavar="N", help="of each policy (default: 100000)")
    add("--runs", type=int, default=2, metavar="N", help="of sb3 per process (default: 2)")
    given = parser.parse_args()
    found, tables = {}, []
    costs = Costs(given.policies, given.steps, given.runs)
    for name in given.only:
        measure, header = PARTS[name]
        found[name], rows = measure(costs)
        tables.append((header, rows))
        results.write(given.json, {"settings": SETTINGS, "parts": found}, PACKAGES)
    costs.bar.close()
    for header, rows in tables:
        print()
        results.print_table(header, rows)
    print_judged("panel_cost", {"parts": found})


if __name__ == "__main__":
    main()
