"""Do both trainers learn the same, and how much faster is the fleet?

    python benchmarks/trainer_equivalence.py [--quick] [--seeds 20] [--json FILE]

Trains the same seeds with stable-baselines3 (a pool of processes, one thread each) and with the
fleet trainer, on the pendulum and the cart-pole, and evaluates every policy from the same starts.
It prints the interquartile mean of returns with its interval, the success rate, learning curves,
and two equivalence tests over seeds (two one-sided tests each): mean returns within ±5 % of
stable-baselines3's (Welch), success rates within ±0.1. With --quick: few seeds, no verdict.
"""

from __future__ import annotations

import argparse
import json
import platform
import tempfile
import time
from dataclasses import dataclass
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from scipy import stats

import integ_gym  # noqa: F401
from integ_gym.eval.statistics import iqm_interval, rate_interval, unpaired_difference
from integ_gym.evidence import EpisodeContext, EvidenceStore, RecordVectorEvidence
from integ_gym.train.fleet import train_fleet
from integ_gym.train.fleet_evidence import TrainingEvidence
from integ_gym.train.ppo import PPOConfig, train
from integ_gym.train.sidecar import read_trained
from integ_gym.train.worker import Progress, cores

TASKS: dict[str, dict[str, Any]] = {
    "IntegPendulum-v0": {"total_steps": 100_000},
    "IntegCartPole-v0": {"total_steps": 100_000},
}
RETURN_MARGIN = 0.05
"""Of the mean return of stable-baselines3's policies."""
SUCCESS_MARGIN = 0.1
EPISODES = 50
PARTS = 10
"""Points of a learning curve."""


@dataclass(frozen=True)
class Group:
    """Policies of one trainer on one task.

    Attributes:
        returns: shape (seeds, EPISODES).
        successes: shape (seeds, EPISODES).
        curve: mean return of the episodes that ended in each part of training, over seeds.
        seconds: wall time of training them all.
    """

    returns: np.ndarray
    successes: np.ndarray
    curve: list[float]
    seconds: float


def configs_of(env_id: str, seeds: int) -> list[PPOConfig]:
    """The runs, one per seed."""
    return [PPOConfig.of(env_id, seed=seed, **TASKS[env_id]) for seed in range(seeds)]


def evidence_of(config: PPOConfig, folder: Path) -> TrainingEvidence:
    """Where a run's training episodes go."""
    cell = f"{config.env_id}-{config.seed}"
    context = EpisodeContext("equivalence", cell, phase="training", trace_every=10_000)
    return TrainingEvidence(folder / "evidence", f"seed{config.seed}", context)


def train_with_sb3(config: PPOConfig, folder: Path) -> None:
    """One run, in a worker process."""
    told = evidence_of(config, folder)
    wrap = partial(RecordVectorEvidence, store=told.store, context=told.context)
    out = folder / f"seed{config.seed}"
    train(config, out, wrap=wrap, progress=False, tensorboard=False)


def run(trainer: str, configs: list[PPOConfig], folder: Path) -> Group:
    """Train and evaluate all runs of one trainer."""
    start = time.perf_counter()
    if trainer == "sb3":
        with Progress().pool(cores()) as pool:
            list(pool.map(train_with_sb3, configs, [folder] * len(configs)))
    else:
        outs = [folder / f"seed{config.seed}" for config in configs]
        train_fleet(configs, outs, evidence=[evidence_of(c, folder) for c in configs])
    seconds = time.perf_counter() - start
    played = [evaluate(folder / f"seed{config.seed}" / "policy.zip") for config in configs]
    returns, successes = (np.array(x) for x in zip(*played, strict=True))
    return Group(returns, successes, learning_curve(folder / "evidence", configs[0]), seconds)


def evaluate(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Returns and successes of the deterministic policy, from fixed starts."""
    policy, card = read_trained(path)
    vector = gym.make_vec(card["env_id"], num_envs=EPISODES, **card["config"]["env_arguments"])
    observation, _ = vector.reset(seed=10_000)
    returns, success = np.zeros(EPISODES), np.zeros(EPISODES)
    going = np.ones(EPISODES, dtype=bool)
    while going.any():
        observation, reward, terminated, truncated, info = vector.step(policy.act(observation))
        returns += reward * going
        ended = going & (terminated | truncated)
        success[ended] = info["success"][ended]
        going &= ~ended
    return returns, success


def learning_curve(store: Path, config: PPOConfig) -> list[float]:
    """Mean return of the training episodes that ended in each part of training."""
    parts: list[list[float]] = [[] for _ in range(PARTS)]
    taken: dict[str, int] = {}
    for record in EvidenceStore(store).records(trace=False):
        cell = record["cell"]
        taken[cell] = taken.get(cell, 0) + record["length"]
        part = min(PARTS - 1, PARTS * taken[cell] // config.rounded_steps)
        parts[part].append(record["return"])
    return [float(np.mean(part)) if part else float("nan") for part in parts]


def compare(env_id: str, sb3: Group, fleet: Group, quick: bool) -> dict[str, Any]:
    """Print and return what was found on one task."""
    print(f"\n{env_id}, {len(sb3.returns)} seeds, {EPISODES} starts each")
    for name, group in (("sb3", sb3), ("fleet", fleet)):
        rate = 60.0 * len(group.returns) / group.seconds
        print(f"  {name:<6} return IQM {iqm_interval(group.returns)}")
        print(f"         success {rate_interval(group.successes.mean(1))}")
        print(f"         training episodes' return {' '.join(f'{x:.0f}' for x in group.curve)}")
        print(f"         {group.seconds:.0f} s for all: {rate:.1f} policies per minute")
    by_seed = sb3.returns.mean(1), fleet.returns.mean(1)
    margin = RETURN_MARGIN * abs(by_seed[0].mean())
    p_return = welch_equivalence(*by_seed, margin)
    success = unpaired_difference(fleet.successes.mean(1), sb3.successes.mean(1))
    p_success = success.p_equivalent(SUCCESS_MARGIN)
    found = p_return < 0.05 and p_success < 0.05
    verdict = "few seeds, no verdict" if quick else ("equivalent" if found else "not shown")
    print(f"  mean return within ±{margin:.1f}: p = {p_return:.3g}")
    print(f"  success within ±{SUCCESS_MARGIN}: p = {p_success:.3g}; {verdict}")
    return {
        "env_id": env_id,
        "seeds": len(sb3.returns),
        "returns": {"sb3": by_seed[0].tolist(), "fleet": by_seed[1].tolist()},
        "curves": {"sb3": sb3.curve, "fleet": fleet.curve},
        "seconds": {"sb3": sb3.seconds, "fleet": fleet.seconds},
        "p_return": p_return,
        "p_success": p_success,
        "verdict": verdict,
    }


def welch_equivalence(first: np.ndarray, second: np.ndarray, margin: float) -> float:
    """Two one-sided Welch tests: small when the means are shown to be within ±``margin``."""
    below = stats.ttest_ind(first + margin, second, equal_var=False, alternative="greater")
    above = stats.ttest_ind(first - margin, second, equal_var=False, alternative="less")
    return float(max(below.pvalue, above.pvalue))


def main() -> None:
    """Train, compare, print; write JSON where asked."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, help="policies per trainer and task (default: 20)")
    parser.add_argument("--quick", action="store_true", help="4 seeds on the pendulum alone")
    parser.add_argument("--json", type=Path, help="also write the numbers here")
    arguments = parser.parse_args()
    seeds = arguments.seeds or (4 if arguments.quick else 20)
    results = []
    for env_id in list(TASKS)[: 1 if arguments.quick else None]:
        configs = configs_of(env_id, seeds)
        with tempfile.TemporaryDirectory() as folder:
            groups = [run(name, configs, Path(folder) / name) for name in ("sb3", "fleet")]
        results.append(compare(env_id, *groups, quick=arguments.quick))
    if arguments.json:
        names = ("integ-gym", "jax", "stable-baselines3", "torch")
        about = {"versions": {n: version(n) for n in names}, "platform": platform.platform()}
        text = json.dumps({"results": results, **about}, indent=1)
        arguments.json.write_text(f"{text}\n", encoding="utf-8")


if __name__ == "__main__":
    main()
