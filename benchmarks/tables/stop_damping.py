"""Does a policy learn the stops? The cart-pole on a short track, where only their damping changes.

    python benchmarks/tables/stop_damping.py --out runs/stop_damping
    python benchmarks/tables/stop_damping.py --out runs/stop_damping --only trained_with-10.0
    python benchmarks/tables/stop_damping.py --out docs/tables/stop_damping --table

In "Does a policy learn the engine?" (`learned_engines.py`) policies lose most of their success on
the short track between the native engine and others, which differ in stops and in steps. Here
nothing differs but one number of the stops: the task, PPO's settings and the amount of experience
are that experiment's, and all is learned and judged on the truth. The stops' damping is the
default, 0.5 s/m, or 10 s/m: a cart then leaves a stop with a fifth of its speed at most, as it does
in MuJoCo, Drake and DART (`benchmarks/cart_stops.py`).

Declared before it was run, and after the engines' losses were known. The damping of 10 s/m was
chosen among 2 to 100 s/m by how fast a cart leaves the stops, and kept when policies of seeds 900
to 907 had learned with it. Seeds 7000 to 7015 of each, 20 starts, the same at both dampings. Two
one-sided tests, corrected by Holm's method: what was learned with one damping loses success with
the other.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))

from learned_engines import DURATION, ENV_ID, PERIOD, PPO, TASKS
from measuring.results import (
    correct_p_values,
    format_difference,
    format_p_value,
    markdown,
)
from measuring.tables import Cells, Row, Table, command, tabulate_success
from measuring.trained import (
    OUTCOME_COLUMNS,
    PACKAGES,
    STARTS,
    Cohort,
    cohorts,
    count_successes,
    default_settings,
    train_by_fleet,
)

from integ_gym.eval.statistics import PROVEN, Difference, paired_difference
from integ_gym.train.ppo import PPOConfig

TASK = TASKS["short track"]
ENVIRONMENT: dict[str, Any] = {
    "duration": DURATION, "track_limit": TASK.track_limit,
    "integrator": "reference", "dt": PERIOD, "control_period": PERIOD, "stop_stiffness": 2000.0,
}  # fmt: skip
SECONDS = TASK.decisions * PERIOD
"""Of the experience of a policy."""

DAMPINGS = (0.5, 10.0)
"""Of the stops, s/m."""

SEEDS = 16
"""Of each."""


def units(first_seed: int) -> list[Cohort]:
    """All there are."""
    cells = [{"trained_with": damping} for damping in DAMPINGS]
    return cohorts(cells, range(first_seed, first_seed + SEEDS))


def run(unit: Cohort) -> list[Row]:
    """Successes of each of a unit's policies, at both dampings."""
    given = {**ENVIRONMENT, "stop_damping": unit.cell["trained_with"]}
    steps = round(SECONDS / PERIOD)
    configs = [
        PPOConfig.of(ENV_ID, seed=seed, env_arguments=given, total_steps=steps, **PPO)
        for seed in unit.seeds
    ]
    acts = train_by_fleet([configs], given)
    rows = []
    for damping in DAMPINGS:
        judged = {**ENVIRONMENT, "stop_damping": damping}
        counts = count_successes(ENV_ID, judged, acts, unit.seeds)
        rows += [{**row, "judged_with": damping} for row in unit.rows(counts)]
    return rows


TABLE = Table(
    columns={
        "trained_with": "damping of the stops in training, s/m",
        "judged_with": "damping of the stops in judging, s/m",
        **OUTCOME_COLUMNS,
    },
    cell=2,
    declared={
        "env_id": ENV_ID,
        "environment": ENVIRONMENT,
        "dampings": DAMPINGS,
        "seeds": SEEDS,
        "seconds": SECONDS,
        "ppo": PPO,
        "defaults": {"PPO": default_settings(PPOConfig, PPO)},
        "starts": STARTS,
        "chosen_on": "seeds 900 to 907: the damping of 10 s/m",
        "tests": [f"learned with {damping:g} s/m loses with the other" for damping in DAMPINGS],
    },
    packages=PACKAGES,
    units=units,
    first_seed=7000,
    run=run,
)


def tables(rows: list[Row], first_seed: int = TABLE.first_seed) -> str:
    """Success with 95 % intervals, and what is lost, as Markdown."""
    what = "damping in training, s/m: judged with"
    return tabulate_success(TABLE, rows, first_seed, what, DAMPINGS, DAMPINGS, _tests)


def _tests(cells: Cells) -> list[str]:
    losses = dict(comparisons(cells))
    p = correct_p_values(losses.values()), correct_p_values(losses.values(), PROVEN)
    lines = [
        (f"{damping:g}", format_difference(lost), *map(format_p_value, of_test))
        for (damping, lost), *of_test in zip(losses.items(), *p, strict=True)
    ]
    header = ("damping in training, s/m", "lost with the other", "p (Holm)", "p (Holm, Gaffke)")
    return markdown(header, lines)


def comparisons(cells: Cells) -> Iterator[tuple[float, Difference]]:
    """Of each damping, what is lost at the other."""
    for damping, other in (DAMPINGS, DAMPINGS[::-1]):
        rates = (cells.rates(damping, judged) for judged in (damping, other))
        yield damping, paired_difference(*rates)


if __name__ == "__main__":
    command(TABLE, tables, __doc__)
