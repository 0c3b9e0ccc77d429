"""Does it help to learn on numerics that pump, and to end on the truth?

    python benchmarks/curriculum.py --out docs/atlas/curriculum.json
    python benchmarks/curriculum.py --out docs/atlas/curriculum.json --table

Five ways to spend the same decisions with the same seeds, near the least torque that lifts the rod
pendulum on the truth within 10 s; all policies are judged on the truth.

- `curriculum`: explicit Euler at 0.05, 0.025 and 0.0125 s, then the truth, a quarter each;
- `truth`: the truth alone;
- `mixture`: the curriculum's four in lanes side by side;
- `easier torque`: the truth alone, with 1.6, 1.4, 1.2 and 1 times the torque, a quarter each;
- `equal ease`: the same with so much torque that each quarter is as far above the critical one as
  the curriculum's is in its discretization.

Networks, optimizer and learning rate go on from stage to stage, so that all differ in their
environments alone.

Declared before it was run: these four torques, seeds 2100 to 2131, 20 starts each; at every torque
`curriculum` is held against each of the others, sixteen one-sided tests of mean success in all,
corrected by Holm's method. What has been run is kept in the file and not run again.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from functools import cache
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from tqdm import tqdm

from integ_gym import Discretization, PPOConfig
from integ_gym.eval.atlas.limits import critical_limit
from integ_gym.eval.statistics import Difference, holm, rate_interval, unpaired_difference
from integ_gym.support import cores, replace_file
from integ_gym.train.fleet import preparation, train_in_stages
from integ_gym.train.fleet.training import Outcome
from integ_gym.train.policy_files import actor_of

ENV_ID = "IntegPendulum-v0"
ENVIRONMENT: dict[str, Any] = {"start": "hanging", "duration": 10.0, "control_period": 0.05}
TRUTH: dict[str, Any] = {"integrator": "reference", "dt": 0.05}
PUMPING: list[dict[str, Any]] = [
    {"integrator": "explicit_euler", "dt": dt} for dt in (0.05, 0.025, 0.0125)
]
TRAINING: dict[str, Any] = {
    "total_steps": 300_000, "batch_size": 512, "gae_lambda": 0.9, "learning_rate": 2e-3,
    "learning_rate_end": 0.0,
}  # fmt: skip
RATIOS = (1.2, 1.4, 1.6, 1.8)
EASIER = (1.6, 1.4, 1.2, 1.0)
ARMS = ("curriculum", "truth", "mixture", "easier torque", "equal ease")
SEEDS = range(2100, 2132)
STARTS = 20
TOGETHER = 8
"""Seeds that are trained at once."""


@dataclass(frozen=True)
class Unit:
    """What one process does at a time."""

    ratio: float
    arm: str
    first_seed: int

    @property
    def name(self) -> str:
        """Its key in the file."""
        return f"{self.arm} at {self.ratio:g}, seeds from {self.first_seed}"

    @property
    def seeds(self) -> range:
        """Of its policies."""
        return range(self.first_seed, self.first_seed + TOGETHER)


def units() -> list[Unit]:
    """All there are."""
    firsts = SEEDS[::TOGETHER]
    return [Unit(ratio, arm, first) for first in firsts for ratio in RATIOS for arm in ARMS]


@cache
def critical(integrator: str, dt: float) -> float:
    """Least torque that lifts the pendulum there within the duration, N m."""
    at = Discretization(integrator, dt, ENVIRONMENT["control_period"])
    rest = {name: value for name, value in ENVIRONMENT.items() if name != "control_period"}
    return critical_limit(ENV_ID, rest, "max_torque", at)


def torque(ratio: float) -> float:
    """N m."""
    return ratio * critical(**TRUTH)


def stages(arm: str, ratio: float) -> list[dict[str, Any]]:
    """The environment's arguments in every stage."""
    limit = torque(ratio)
    common = {**ENVIRONMENT, "max_torque": limit}
    if arm == "truth":
        return [{**common, **TRUTH}]
    if arm == "mixture":
        return [{**common, "mixture": [*PUMPING, TRUTH]}]
    turns = [*PUMPING, TRUTH]
    if arm == "curriculum":
        return [{**common, **turn} for turn in turns]
    factors = EASIER if arm == "easier torque" else [equal_ease(turn) for turn in turns]
    return [{**common, **TRUTH, "max_torque": limit * factor} for factor in factors]


def equal_ease(turn: dict[str, Any]) -> float:
    """Factor on the truth's torque that makes it as easy as another discretization."""
    return critical(**TRUTH) / critical(**turn)


def config(seed: int, arguments: dict[str, Any]) -> PPOConfig:
    """Of one stage of a policy's training."""
    return PPOConfig.of(ENV_ID, seed=seed, env_arguments=arguments, **TRAINING)


def run(unit: Unit) -> list[int]:
    """Successes on the truth of each of a unit's policies, of `STARTS`."""
    trained = train_in_stages(
        [
            [
                PPOConfig.of(ENV_ID, seed=seed, env_arguments=given, **TRAINING)
                for seed in unit.seeds
            ]
            for given in stages(unit.arm, unit.ratio)
        ]
    )
    return [
        successes(outcome, torque(unit.ratio), seed)
        for outcome, seed in zip(trained, unit.seeds, strict=True)
    ]


def successes(outcome: Outcome, limit: float, seed: int) -> int:
    """Of a policy on the truth, from starts of its seed's own."""
    given = {**ENVIRONMENT, **TRUTH, "max_torque": limit}
    envs = gym.make_vec(ENV_ID, num_envs=STARTS, **given)
    network, space = config(seed, given), envs.single_action_space
    policy = actor_of(outcome.weights, len(network.net_arch), network.activation, space)
    observed, _ = envs.reset(seed=[1_000_000 + STARTS * seed + start for start in range(STARTS)])
    succeeded = ended = np.zeros(STARTS, dtype=bool)
    while not ended.all():
        observed, _, terminated, truncated, info = envs.step(policy.act(observed))
        ending = (terminated | truncated) & ~ended
        succeeded = succeeded | (ending & info["success"])
        ended = ended | ending
    envs.close()
    return int(succeeded.sum())


def run_missing(path: Path, workers: int) -> None:
    """Run what the file has not, each written as it is done."""
    done = read(path)
    left = [unit for unit in units() if unit.name not in done]
    pool = ProcessPoolExecutor(workers, get_context("spawn"), preparation("cpu"), (0,))
    with pool, tqdm(total=len(left), unit="unit") as bar:
        for future in as_completed(futures := {pool.submit(run, unit): unit for unit in left}):
            done[futures[future].name] = future.result()
            ordered = {unit.name: done[unit.name] for unit in units() if unit.name in done}
            text = ",\n".join(f" {json.dumps(name)}: {ordered[name]}" for name in ordered)
            replace_file(path, f"{{\n{text}\n}}\n".encode())
            bar.update()


def read(path: Path) -> dict[str, list[int]]:
    """Successes by unit, of a file that need not be there."""
    found: dict[str, list[int]] = json.loads(path.read_text("utf-8")) if path.exists() else {}
    return found


def rates(done: dict[str, list[int]], ratio: float, arm: str) -> list[float]:
    """Success rate of every seed that was run."""
    own = [unit for unit in units() if (unit.ratio, unit.arm) == (ratio, arm)]
    return [count / STARTS for unit in own for count in done.get(unit.name, [])]


def table(done: dict[str, list[int]]) -> str:
    """Success with 95 % intervals, and what the curriculum gains, as Markdown."""
    lines = [f"| torque | {' | '.join(ARMS)} |", "|---" * (1 + len(ARMS)) + "|"]
    for ratio in RATIOS:
        cells = [rates(done, ratio, arm) for arm in ARMS]
        shown = (
            f"{found.estimate:.2f} ({found.low:.2f}–{found.high:.2f})"
            for found in (rate_interval(values) for values in cells)
        )
        lines.append(f"| {ratio:g} | {' | '.join(shown)} |")
    lines += ["", "| torque | held against | curriculum gains | p (Holm) |", "|---|---|---|---|"]
    gains = list(comparisons(done))
    corrected = holm([difference.p_greater() for _, _, difference in gains])
    for (ratio, arm, difference), p in zip(gains, corrected, strict=True):
        found = difference.interval
        gained = f"{found.estimate:z.2f} ({found.low:z.2f} to {found.high:z.2f})"
        lines.append(f"| {ratio:g} | {arm} | {gained} | {p:.3f} |")
    return "\n".join(lines) + "\n"


def comparisons(done: dict[str, list[int]]) -> Iterator[tuple[float, str, Difference]]:
    """The declared ones."""
    for ratio in RATIOS:
        ours = rates(done, ratio, "curriculum")
        for arm in ARMS[1:]:
            yield ratio, arm, unpaired_difference(ours, rates(done, ratio, arm))


def main() -> None:
    """Run, or print what was found."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n", 1)[0])
    parser.add_argument("--out", type=Path, required=True, metavar="FILE", help="JSON of successes")
    parser.add_argument("--table", action="store_true", help="run nothing: print the tables")
    parser.add_argument("--workers", type=int, default=cores(), metavar="N", help="processes")
    given = parser.parse_args()
    if not given.table:
        run_missing(given.out, given.workers)
    print(table(read(given.out)), end="")


if __name__ == "__main__":
    main()
