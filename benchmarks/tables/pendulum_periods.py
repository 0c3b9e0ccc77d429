"""Does a control period other than the one that was tuned for make learning worse?

    python benchmarks/tables/pendulum_periods.py --out runs/pendulum_periods
    python benchmarks/tables/pendulum_periods.py --out runs/pendulum_periods --only period-0.2
    python benchmarks/tables/pendulum_periods.py --out docs/tables/pendulum_periods --table

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

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))

from measuring.results import correct_p_values, format_difference, format_p_value, markdown
from measuring.tables import Cells, Row, Table, command, tabulate_success
from measuring.trained import (
    OUTCOME_COLUMNS,
    PACKAGES,
    STARTS,
    Cohort,
    cohorts,
    scale_to_period,
    train_and_count_successes,
)

from integ_gym.eval.statistics import Difference, unpaired_difference
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

LEARNING_RATES = {"learning_rate": 2e-3, "learning_rate_end": 0.0}

PERIODS = (0.2, 0.1, 0.05, 0.025, 0.0125)
"""s."""

ARMS = ("per decision", "per second")
SEEDS = 16
"""Of each arm at each period."""

TESTED = (max(PERIODS), min(PERIODS))
"""Periods at which the gain of `per second` is tested, s."""


def settings(arm: str, period: float) -> dict[str, Any]:
    """Of the trainer."""
    common = {"total_steps": round(SECONDS / period), **LEARNING_RATES}
    own = {"n_steps": STEPS, "batch_size": BATCH, "gae_lambda": GAE_LAMBDA}
    slower = period / PERIOD
    if arm == "per decision":
        return {**common, **own, "discount_time": DISCOUNT_TIME * slower}
    return {**common, **scale_to_period(own, slower), "discount_time": DISCOUNT_TIME}


def units(first_seed: int) -> list[Cohort]:
    """All there are."""
    cells = [{"period": period, "arm": arm} for period in PERIODS for arm in ARMS]
    return cohorts(cells, range(first_seed, first_seed + SEEDS))


def run(unit: Cohort) -> list[Row]:
    """Successes of each of a unit's policies."""
    period, arm = unit.cell["period"], unit.cell["arm"]
    given = {**ENVIRONMENT, "dt": period, "control_period": period}
    configs = [
        PPOConfig.of(ENV_ID, seed=seed, env_arguments=given, **settings(arm, period))
        for seed in unit.seeds
    ]
    return unit.rows(train_and_count_successes([configs], given))


TABLE = Table(
    columns={
        "period": "control period, s",
        "arm": "what stays as at the period that the settings were tuned for",
        **OUTCOME_COLUMNS,
    },
    cell=2,
    declared={
        "env_id": ENV_ID,
        "environment": ENVIRONMENT,
        "periods": PERIODS,
        "arms": ARMS,
        "seeds": SEEDS,
        "tuned_for": PERIOD,
        "seconds": SECONDS,
        "n_steps": STEPS,
        "batch_size": BATCH,
        "gae_lambda": GAE_LAMBDA,
        "discount_time": DISCOUNT_TIME,
        **LEARNING_RATES,
        "starts": STARTS,
        "tests": [f"per second gains at {period} s" for period in TESTED],
    },
    packages=PACKAGES,
    units=units,
    first_seed=2200,
    run=run,
)


def tables(rows: list[Row], first_seed: int = TABLE.first_seed) -> str:
    """Success with 95 % intervals, and what is gained by physical time, as Markdown."""
    return tabulate_success(TABLE, rows, first_seed, "control period, s", PERIODS, ARMS, _tests)


def _tests(cells: Cells) -> list[str]:
    gains = dict(comparisons(cells))
    corrected = correct_p_values([gains[period] for period in TESTED])
    p = {period: format_p_value(one) for period, one in zip(TESTED, corrected, strict=True)}
    lines = [
        (f"{period:g}", format_difference(gain), p.get(period, ""))
        for period, gain in gains.items()
    ]
    return markdown(("control period, s", "`per second` gains", "p (Holm)"), lines)


def comparisons(cells: Cells) -> Iterator[tuple[float, Difference]]:
    """Gains at all periods but the one at which both arms are the same."""
    for period in PERIODS:
        if period != PERIOD:
            decision, second = (cells.rates(period, arm) for arm in ARMS)
            yield period, unpaired_difference(second, decision)


if __name__ == "__main__":
    command(TABLE, tables, __doc__)
