"""Does the atlas say what other seeds would?

    python benchmarks/tables/fresh_points.py --out runs/fresh_points
    python benchmarks/tables/fresh_points.py --out runs/fresh_points --only point-1
    python benchmarks/tables/fresh_points.py --out docs/tables/fresh_points --table

Six points of the rod pendulum's phase diagram, drawn among all training grounds at the limits that
have a summary, are trained anew from their specification with seeds, and judged on the truth from
starts, that nothing else was made with. Declared before it was run: the seed that draws them, seeds
2700 to 2715, 20 starts each. A point is found again where its new success lies within the 95 %
interval that the phase diagram gives; were both measured alike, 83 % would.
"""

from __future__ import annotations

import sys
from functools import cache
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from measuring.results import format_difference, format_success, markdown
from measuring.tables import Cells, Row, Table, command
from measuring.trained import (
    OUTCOME_COLUMNS,
    PACKAGES,
    STARTS,
    Cohort,
    cohorts,
    train_and_count_successes,
)

from integ_gym.eval.atlas.running import finished
from integ_gym.eval.atlas.specification import Atlas, read_atlas
from integ_gym.eval.atlas.summaries import points, read_agreements
from integ_gym.eval.panel.cells import training_arguments
from integ_gym.eval.statistics import draws_for, rate_interval, unpaired_difference
from integ_gym.train.ppo import PPOConfig

ROOT = Path(__file__).parents[2]
SPEC = ROOT / "specs" / "atlas" / "rod_pendulum.toml"
SUMMARIES = ROOT / "docs" / "atlas" / "rod_pendulum"
LIMITS = (1.5, 1.7, 2.0, 2.5, 3.0)
"""That had a summary when the points were drawn, over the critical one."""

DRAWN_BY = 2700
"""The seed."""

POINTS = 6
SEEDS = 16
"""Of each point."""


@cache
def _atlas() -> Atlas:
    return read_atlas(SPEC)


@cache
def drawn() -> tuple[tuple[float, str], ...]:
    """Limit and training ground of every point."""
    grid = [(limit, home.name) for limit in LIMITS for home in _atlas().panel.train]
    places = np.random.default_rng(DRAWN_BY).choice(len(grid), POINTS, replace=False)
    return tuple(grid[place] for place in places)


def units(first_seed: int) -> list[Cohort]:
    """All there are."""
    cells = [
        {"point": point, "torque": limit, "trained_on": name}
        for point, (limit, name) in enumerate(drawn(), 1)
    ]
    return cohorts(cells, range(first_seed, first_seed + SEEDS))


def run(unit: Cohort) -> list[Row]:
    """Successes on the truth of each of a unit's policies."""
    limit, name = unit.cell["torque"], unit.cell["trained_on"]
    panel = next(block.panel for block in _atlas().blocks() if block.ratio == limit)
    home = next(home for home in panel.train if home.name == name)
    given = training_arguments(home, panel.environment)
    configs = [
        PPOConfig.of(panel.env_id, seed=seed, env_arguments=given, **panel.training)
        for seed in unit.seeds
    ]
    truth = panel.reference
    assert truth is not None
    judged = training_arguments(truth, panel.environment)
    return unit.rows(train_and_count_successes([configs], judged))


TABLE = Table(
    columns={
        "point": "which of the drawn ones",
        "torque": "over the critical one",
        "trained_on": "the discretization of training",
        **OUTCOME_COLUMNS,
        "successes": "of the starts, on the truth",
    },
    cell=3,
    declared={
        "atlas": "rod pendulum",
        "limits": LIMITS,
        "drawn_by": DRAWN_BY,
        "points": POINTS,
        "seeds": SEEDS,
        "starts": STARTS,
        "training": dict(_atlas().panel.training),
        "tests": [],
    },
    packages=PACKAGES,
    units=units,
    first_seed=2700,
    run=run,
)


def tables(rows: list[Row], first_seed: int = TABLE.first_seed) -> str:
    """Success with 95 % intervals of points that were run, beside the phase diagram's."""
    summarized = points(_atlas(), finished(_atlas(), SUMMARIES), read_agreements(SUMMARIES))
    published = {(point.ratio, point.home.name): point.on_truth for point in summarized}
    cells, lines = Cells(rows, TABLE.cell_columns), []
    for point, (limit, name) in enumerate(drawn(), 1):
        fresh, before = cells.rates(point, limit, name), published[limit, name]
        if len(fresh) < SEEDS:
            continue
        own = rate_interval(before, draws=draws_for(len(before)))
        lines.append(
            (
                f"{point}",
                name,
                f"{limit:g}",
                f"{own.estimate:.2f} ({own.low:.2f}–{own.high:.2f})",
                format_success(fresh),
                "yes" if own.low <= float(np.mean(fresh)) <= own.high else "no",
                format_difference(unpaired_difference(fresh, before)),
            )
        )
    header = ("point", "trained on", "torque", "phase diagram", "fresh seeds", "within")
    return "\n".join(markdown((*header, "difference"), lines)) + "\n"


if __name__ == "__main__":
    command(TABLE, tables, __doc__)
