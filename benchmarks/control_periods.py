"""Does a control period other than the one that was tuned for make learning worse?

    python benchmarks/control_periods.py --out docs/atlas/control_periods.json
    python benchmarks/control_periods.py --out docs/atlas/control_periods.json --table

Farrahi and Mahmood (2023, *Reducing the cost of cycle-time tuning for real-world policy
optimization*, arXiv:2305.05760) report that PPO fails to learn at other cycle times than the one
that its hyperparameters were tuned for, and does not where discount, λ and batch follow the time.
Tallec, Blier and Ollivier (2019, *Making deep Q-learning methods robust to time discretization*,
arXiv:1901.09732) report that Q-learning fails as the period goes to 0. Here PPO learns the swing-up
of the rod pendulum on the truth, all runs through the same 15 000 s:

- `per decision`: discount, λ, length of rollouts and of batches as at 0.05 s, whatever the period;
- `per second`: the discount's time constant and λ's, and the time that rollouts and batches span.

At 0.05 s both are the same. Declared before it was run: five periods, seeds 2200 to 2215, 20 starts
each, success within 10 s at twice the critical torque. The trend is reproduced where `per second`
is better than `per decision`, at the shortest period and at the longest: two one-sided tests,
corrected by Holm's method. Gains at the periods between are printed without a test.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from measuring.results import format_difference, format_p_value
from measuring.trained import Done, Experiment, Unit, by_fleet, command, in_the_same_time

from integ_gym.eval.statistics import Difference, holm, unpaired_difference
from integ_gym.train.ppo import PPOConfig

ENV_ID = "IntegPendulum-v0"
ENVIRONMENT: dict[str, Any] = {
    "start": "hanging", "duration": 10.0, "max_torque": 0.84, "integrator": "reference",
}  # fmt: skip
PERIOD = 0.05
"""At which both arms are the same, s."""

SECONDS = 15_000.0
"""Of experience, of all environments together."""

STEPS, BATCH, GAE_LAMBDA, DISCOUNT_TIME = 256, 512, 0.9, 1.0
"""Decisions of a rollout in each environment and of a batch, λ, and τ in s, at `PERIOD`."""

EXPERIMENT = Experiment(
    values=(0.2, 0.1, 0.05, 0.025, 0.0125),
    arms=("per decision", "per second"),
    seeds=range(2200, 2216),
    settings={
        "env_id": ENV_ID,
        "environment": ENVIRONMENT,
        "tuned_for": PERIOD,
        "seconds": SECONDS,
        "n_steps": STEPS,
        "batch_size": BATCH,
        "gae_lambda": GAE_LAMBDA,
        "discount_time": DISCOUNT_TIME,
    },
)
DECLARED = (max(EXPERIMENT.values), min(EXPERIMENT.values))


def settings(arm: str, period: float) -> dict[str, Any]:
    """Of the trainer."""
    common = {
        "total_steps": round(SECONDS / period), "learning_rate": 2e-3, "learning_rate_end": 0.0,
    }  # fmt: skip
    own = {"n_steps": STEPS, "batch_size": BATCH, "gae_lambda": GAE_LAMBDA}
    slower = period / PERIOD
    if arm == "per decision":
        return {**common, **own, "discount_time": DISCOUNT_TIME * slower}
    return {**common, **in_the_same_time(own, slower), "discount_time": DISCOUNT_TIME}


def run(unit: Unit) -> list[int]:
    """Successes of each of a unit's policies."""
    given = {**ENVIRONMENT, "dt": unit.value, "control_period": unit.value}
    configs = [
        PPOConfig.of(ENV_ID, seed=seed, env_arguments=given, **settings(unit.arm, unit.value))
        for seed in unit.seeds
    ]
    return by_fleet([configs], given)


def tables(done: Done) -> str:
    """Success with 95 % intervals, and what is gained by physical time, as Markdown."""
    return EXPERIMENT.tables(done, "control period, s", lambda: _tests(done))


def _tests(done: Done) -> list[str]:
    lines = ["| control period, s | `per second` gains | p (Holm) |", "|---|---|---|"]
    gains = dict(comparisons(done))
    tested = [period for period in gains if period in DECLARED]
    corrected = holm([gains[period].p_greater() for period in tested])
    p = {period: format_p_value(one) for period, one in zip(tested, corrected, strict=True)}
    for period, gain in gains.items():
        lines.append(f"| {period:g} | {format_difference(gain)} | {p.get(period, '')} |")
    return lines


def comparisons(done: Done) -> Iterator[tuple[float, Difference]]:
    """Gains at all periods but the one at which both arms are the same."""
    for period in EXPERIMENT.values:
        if period != PERIOD:
            decision, second = (EXPERIMENT.rates(done, period, arm) for arm in EXPERIMENT.arms)
            yield period, unpaired_difference(second, decision)


if __name__ == "__main__":
    command(EXPERIMENT, run, tables, __doc__)
