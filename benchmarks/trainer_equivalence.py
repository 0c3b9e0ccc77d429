"""Do both trainers learn the same, and how much faster is the fleet?

    python benchmarks/trainer_equivalence.py [--only CASE …] [--seeds 20] [--first-seed 0]
                                             [--json FILE]

Trains the same seeds with stable-baselines3 (a pool of processes, one thread each) and with the
fleet trainer, and evaluates every policy from the same starts. It prints the interquartile mean of
returns with its interval, the success rate, learning curves, and equivalence tests over seeds (two
one-sided tests each): interquartile means over seeds of the return, and of the return while
learning, within ±5 % of stable-baselines3's (Yuen's test), plain means of the return within the
same (Welch's test); success rates within ±0.1. Interquartile means leave failed seeds out, so these
are counted beside them.

pendulum      the defaults of `integ-gym train`, 100 000 decisions
cart-pole     the same in its environment
minibatches   the pendulum with 4 environments × 1024 steps and minibatches of 64
swing-up      the quick panel's training on `rk4`: 300 000 decisions, minibatches of 512
"""

from __future__ import annotations

import tempfile
import time
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from measuring import results
from scipy import stats

import integ_gym  # noqa: F401
from integ_gym.eval.panel.spec import read_spec
from integ_gym.eval.statistics import iqm_interval, p_equivalent, rate_interval
from integ_gym.evidence.labels import EpisodeContext
from integ_gym.evidence.store import EvidenceStore
from integ_gym.train.config import TrainingEvidence
from integ_gym.train.fleet.training import train_fleet
from integ_gym.train.policy_files.sidecar import read_trained
from integ_gym.train.ppo import PPOConfig
from integ_gym.train.runs import train_ppo

_QUICK = read_spec("quick")
CASES: dict[str, tuple[str, dict[str, Any]]] = {
    "pendulum": ("IntegPendulum-v0", {"total_steps": 100_000}),
    "cart-pole": ("IntegCartPole-v0", {"total_steps": 100_000}),
    "minibatches": (
        "IntegPendulum-v0",
        {"total_steps": 100_000, "n_envs": 4, "n_steps": 1024, "batch_size": 64, "n_epochs": 10},
    ),
    "swing-up": (
        "IntegPendulum-v0",
        {
            **_QUICK.training,
            "env_arguments": {
                **_QUICK.environment,
                "integrator": "rk4",
                "dt": 0.05,
                "control_period": 0.05,
            },
        },
    ),
}
"""Environment, and what differs from the defaults of `PPOConfig`."""

LEVEL = 0.05
RETURN_MARGIN = 0.05
"""Of the interquartile mean of stable-baselines3's policies."""
TRIM = 0.25
SUCCESS_MARGIN = 0.1
EPISODES = 50
FAILED = 0.95
"""Success rate below which a seed counts as failed."""
PARTS = 10
"""Points of a learning curve."""
PACKAGES = ("integ-gym", "jax", "stable-baselines3", "torch")


@dataclass(frozen=True)
class Group:
    """Policies of one trainer in one case.

    Attributes:
        returns: shape (seeds, EPISODES).
        successes: shape (seeds, EPISODES).
        curves: mean return of the episodes that ended in each part of training, (seeds, PARTS).
        seconds: wall time of training them all.
    """

    returns: np.ndarray
    successes: np.ndarray
    curves: np.ndarray
    seconds: float


def run(trainer: str, configs: list[PPOConfig], folder: Path) -> Group:
    """Train and evaluate all runs of one trainer."""
    start = time.perf_counter()
    outs = [folder / f"seed{config.seed}" for config in configs]
    train = partial(train_ppo, tensorboard=False) if trainer == "sb3" else train_fleet
    contexts = [
        EpisodeContext("equivalence", out.name, phase="training", trace_every=10_000)
        for out in outs
    ]
    evidence = [TrainingEvidence(folder / "evidence", one.cell, one) for one in contexts]
    train(configs, outs, evidence=evidence)
    seconds = time.perf_counter() - start
    played = [evaluate(out / "policy.zip") for out in outs]
    returns, successes = (np.array(x) for x in zip(*played, strict=True))
    return Group(returns, successes, learning_curves(folder / "evidence", configs), seconds)


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


def learning_curves(store: Path, configs: list[PPOConfig]) -> np.ndarray:
    """Mean return of the training episodes that ended in each part of training, (seeds, PARTS)."""
    totals, counts = np.zeros((2, len(configs), PARTS))
    taken = np.zeros(len(configs), dtype=int)
    places = {f"seed{config.seed}": place for place, config in enumerate(configs)}
    for record in EvidenceStore(store).records(trace=False):
        place = places[record["cell"]]
        taken[place] += record["length"]
        part = min(PARTS - 1, PARTS * taken[place] // configs[place].rounded_steps)
        totals[place, part] += record["return"]
        counts[place, part] += 1
    return totals / np.maximum(counts, 1)


def compare(case: str, sb3: Group, fleet: Group) -> dict[str, Any]:
    """Print and return what was found in one case."""
    print(f"\n{case}, {len(sb3.returns)} seeds, {EPISODES} starts each")
    for name, group in (("sb3", sb3), ("fleet", fleet)):
        rate = 60.0 * len(group.returns) / group.seconds
        curve = " ".join(f"{value:.0f}" for value in group.curves.mean(0))
        print(f"  {name:<6} return IQM {iqm_interval(group.returns)}")
        print(f"         success {rate_interval(group.successes.mean(1))}")
        print(f"         training episodes' return {curve}")
        print(f"         {group.seconds:.0f} s for all: {rate:.1f} policies per minute")
    p_values = {
        "return": equivalence(sb3.returns.mean(1), fleet.returns.mean(1), TRIM),
        "return while learning": equivalence(sb3.curves.mean(1), fleet.curves.mean(1), TRIM),
        "plain mean of return": equivalence(sb3.returns.mean(1), fleet.returns.mean(1), 0.0),
        "success": p_equivalent(fleet.successes.mean(1), sb3.successes.mean(1), SUCCESS_MARGIN),
    }
    for name, p_value in p_values.items():
        within = f"±{SUCCESS_MARGIN}" if name == "success" else f"±{RETURN_MARGIN:.0%}"
        outcome = "equivalent" if p_value < LEVEL else "not shown to be equivalent"
        p_text = f"p = {p_value:.2g}" if p_value else "all alike"
        print(f"  {name} within {within}: {p_text}; {outcome}")
    groups = {"sb3": sb3, "fleet": fleet}
    failed = {name: int((g.successes.mean(1) < FAILED).sum()) for name, g in groups.items()}
    p_values["failed seeds alike"] = difference(failed["sb3"], failed["fleet"], len(sb3.returns))
    counts = " and ".join(f"{count} ({name})" for name, count in failed.items())
    unlike = p_values["failed seeds alike"]
    print(
        f"  seeds with success below {FAILED}: {counts}; p = {unlike:.2g} (Fisher's exact test); "
        f"{'they differ' if unlike < LEVEL else 'no difference shown'}"
    )
    return {
        "case": case,
        "seeds": len(sb3.returns),
        "returns": {name: group.returns.mean(1).tolist() for name, group in groups.items()},
        "failed": failed,
        "successes": {name: group.successes.mean(1).tolist() for name, group in groups.items()},
        "curves": {name: group.curves.tolist() for name, group in groups.items()},
        "seconds": {name: group.seconds for name, group in groups.items()},
        "p_values": p_values,
    }


def difference(one: int, other: int, of: int) -> float:
    """P-value of two counts being of one rate, by Fisher's exact test."""
    return float(stats.fisher_exact([[one, of - one], [other, of - other]]).pvalue)


def equivalence(sb3: np.ndarray, fleet: np.ndarray, trim: float) -> float:
    """Two one-sided tests of trimmed means: small when both are shown to be within the margin.

    ``trim`` is the share cut from each end: 0.25 for interquartile means, 0 for plain ones.
    Source: Yuen (1974), *The two-sample trimmed t for unequal population variances*, Biometrika 61.
    """
    margin = RETURN_MARGIN * abs(stats.trim_mean(sb3, trim))
    if all(np.ptp(stats.trimboth(values, trim)) == 0.0 for values in (sb3, fleet)):
        return float(abs(np.median(sb3) - np.median(fleet)) >= margin)
    below = stats.ttest_ind(sb3 + margin, fleet, equal_var=False, trim=trim, alternative="greater")
    above = stats.ttest_ind(sb3 - margin, fleet, equal_var=False, trim=trim, alternative="less")
    return float(max(below.pvalue, above.pvalue))


def main() -> None:
    """Train, compare, print; write JSON where asked."""
    parser = results.parser(__doc__, file=True)
    add = parser.add_argument
    add("--only", nargs="+", choices=list(CASES), default=list(CASES), metavar="CASE")
    add("--seeds", type=int, default=20, metavar="N", help="per trainer and case (default: 20)")
    add("--first-seed", type=int, default=0, metavar="N", help="the others follow (default: 0)")
    add("--steps", type=int, metavar="N", help="decisions of each (default: the case's)")
    given = parser.parse_args()
    found = []
    for case in given.only:
        seeds = range(given.first_seed, given.first_seed + given.seeds)
        env_id, overrides = CASES[case]
        steps = {} if given.steps is None else {"total_steps": given.steps}
        configs = [PPOConfig.of(env_id, seed=seed, **{**overrides, **steps}) for seed in seeds]
        with tempfile.TemporaryDirectory() as folder:
            groups = [run(name, configs, Path(folder) / name) for name in ("sb3", "fleet")]
        found.append({**compare(case, *groups), "first_seed": given.first_seed})
        results.write(given.json, {"results": found}, PACKAGES)


if __name__ == "__main__":
    main()
