"""Does it help to learn on numerics that pump, and to end on the truth?

    python benchmarks/tables/curriculum.py --out runs/curriculum
    python benchmarks/tables/curriculum.py --out runs/curriculum --only torque-1.4
    python benchmarks/tables/curriculum.py --out docs/tables/curriculum --table

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
`curriculum` is compared with each of the others, sixteen one-sided tests of mean success in all,
corrected by Holm's method.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from functools import cache
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
    train_and_count_successes,
)

from integ_gym.envs.settings import Discretization
from integ_gym.eval.atlas.specification import critical_limit
from integ_gym.eval.statistics import Difference, unpaired_difference
from integ_gym.train.ppo import PPOConfig

ENV_ID = "IntegPendulum-v0"
PERIOD = 0.05
"""Control period, s."""

ENVIRONMENT: dict[str, Any] = {"start": "hanging", "duration": 10.0}
TRUTH: dict[str, Any] = {"integrator": "reference", "dt": PERIOD}
PUMPING: list[dict[str, Any]] = [
    {"integrator": "explicit_euler", "dt": dt} for dt in (0.05, 0.025, 0.0125)
]
EASIER = (1.6, 1.4, 1.2, 1.0)
TRAINING: dict[str, Any] = {
    "total_steps": 300_000, "batch_size": 512, "gae_lambda": 0.9, "learning_rate": 2e-3,
    "learning_rate_end": 0.0,
}  # fmt: skip
TORQUES = (1.2, 1.4, 1.6, 1.8)
"""Over the critical one."""

ARMS = ("curriculum", "truth", "mixture", "easier torque", "equal ease")
SEEDS = 32
"""Of each arm at each torque."""


@cache
def critical(integrator: str, dt: float) -> float:
    """Least torque that lifts the pendulum there within the duration, N m."""
    at = Discretization(integrator, dt, PERIOD)
    return critical_limit(ENV_ID, ENVIRONMENT, "max_torque", at)


def torque(ratio: float) -> float:
    """N m."""
    return ratio * critical(**TRUTH)


def stages(arm: str, ratio: float) -> list[dict[str, Any]]:
    """The environment's arguments in every stage."""
    limit = torque(ratio)
    common = {**ENVIRONMENT, "control_period": PERIOD, "max_torque": limit}
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


def units(first_seed: int) -> list[Cohort]:
    """All there are."""
    cells = [{"torque": ratio, "arm": arm} for ratio in TORQUES for arm in ARMS]
    return cohorts(cells, range(first_seed, first_seed + SEEDS))


def run(unit: Cohort) -> list[Row]:
    """Successes on the truth of each of a unit's policies."""
    ratio = unit.cell["torque"]
    configs = [
        [PPOConfig.of(ENV_ID, seed=seed, env_arguments=given, **TRAINING) for seed in unit.seeds]
        for given in stages(unit.cell["arm"], ratio)
    ]
    judged = {**ENVIRONMENT, **TRUTH, "control_period": PERIOD, "max_torque": torque(ratio)}
    return unit.rows(train_and_count_successes(configs, judged))


TABLE = Table(
    columns={
        "torque": "over the critical one",
        "arm": "the way to spend the decisions",
        **OUTCOME_COLUMNS,
        "successes": "of the starts, on the truth",
    },
    cell=2,
    declared={
        "env_id": ENV_ID,
        "environment": ENVIRONMENT,
        "torques": TORQUES,
        "arms": ARMS,
        "seeds": SEEDS,
        "control_period": PERIOD,
        "truth": TRUTH,
        "pumping": PUMPING,
        "easier": EASIER,
        "training": TRAINING,
        "starts": STARTS,
        "tests": [f"{ARMS[0]} gains over {arm}, at each torque" for arm in ARMS[1:]],
    },
    packages=PACKAGES,
    units=units,
    first_seed=2100,
    run=run,
)


def tables(rows: list[Row], first_seed: int = TABLE.first_seed) -> str:
    """Success with 95 % intervals, and what the curriculum gains, as Markdown."""
    return tabulate_success(
        TABLE, rows, first_seed, "torque over the critical one", TORQUES, ARMS, _tests
    )


def _tests(cells: Cells) -> list[str]:
    gains = list(comparisons(cells))
    corrected = correct_p_values([difference for _, _, difference in gains])
    lines = [
        (f"{ratio:g}", arm, format_difference(difference), format_p_value(p))
        for (ratio, arm, difference), p in zip(gains, corrected, strict=True)
    ]
    return markdown(("torque", "compared with", "curriculum gains", "p (Holm)"), lines)


def comparisons(cells: Cells) -> Iterator[tuple[float, str, Difference]]:
    """The declared ones."""
    for ratio in TORQUES:
        ours = cells.rates(ratio, "curriculum")
        for arm in ARMS[1:]:
            yield ratio, arm, unpaired_difference(ours, cells.rates(ratio, arm))


if __name__ == "__main__":
    command(TABLE, tables, __doc__)
