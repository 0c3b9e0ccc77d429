"""Does the atlas say what other seeds would?

    python benchmarks/fresh_points.py --out docs/atlas/fresh_points.json
    python benchmarks/fresh_points.py --out docs/atlas/fresh_points.json --table

Six points of the rod pendulum's phase diagram, drawn among all training grounds at the limits that
have a summary, are trained anew from their specification with seeds, and judged on the truth from
starts, that nothing else was made with. Declared before it was run: the seed that draws them, seeds
2700 to 2715, 20 starts each. A point is found again where its new success lies within the 95 %
interval that the phase diagram gives; were both measured alike, 83 % would.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from pathlib import Path

import numpy as np
from measuring.results import format_difference, format_success
from measuring.trained import Done, Experiment, Unit, by_fleet, command

from integ_gym.eval.atlas.running import finished
from integ_gym.eval.atlas.specification import Atlas, read_atlas
from integ_gym.eval.atlas.summaries import Point, points, read_agreements
from integ_gym.eval.panel.cells import training_arguments
from integ_gym.eval.statistics import draws_for, rate_interval, unpaired_difference
from integ_gym.train.ppo import PPOConfig

ROOT = Path(__file__).parents[1]
SPEC = ROOT / "specs" / "atlas" / "rod_pendulum.toml"
SUMMARIES = ROOT / "docs" / "atlas" / "rod_pendulum"
LIMITS = (1.5, 1.7, 2.0, 2.5, 3.0)
"""That had a summary when the points were drawn, over the critical one."""

DRAWN_BY = 2700
COUNT = 6
EXPERIMENT = Experiment(
    values=tuple(range(1, COUNT + 1)),
    arms=("fresh seeds",),
    seeds=range(2700, 2716),
    settings={"atlas": "rod pendulum", "limits": LIMITS, "drawn_by": DRAWN_BY},
)


@cache
def _atlas() -> Atlas:
    return read_atlas(SPEC)


@cache
def drawn() -> tuple[tuple[float, str], ...]:
    """Limit and training ground of every point."""
    grid = [(limit, home.name) for limit in LIMITS for home in _atlas().panel.train]
    places = np.random.default_rng(DRAWN_BY).choice(len(grid), COUNT, replace=False)
    return tuple(grid[place] for place in places)


def run(unit: Unit) -> list[int]:
    """Successes on the truth of each of a unit's policies."""
    limit, name = drawn()[int(unit.value) - 1]
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
    return by_fleet([configs], judged)


def tables(done: Done) -> str:
    """Success with 95 % intervals beside the phase diagram's, as Markdown."""
    return "\n".join(_beside(done)) + "\n" if EXPERIMENT.complete(done) else ""


def _beside(done: Done) -> Iterator[str]:
    yield "| point | trained on | torque | phase diagram | fresh seeds | within | difference |"
    yield "|---" * 7 + "|"
    published = {(point.ratio, point.home.name): point for point in _published()}
    for value, (limit, name) in zip(EXPERIMENT.values, drawn(), strict=True):
        fresh, before = (
            EXPERIMENT.rates(done, value, "fresh seeds"),
            published[limit, name].on_truth,
        )
        own = rate_interval(before, draws=draws_for(len(before)))
        within = "yes" if own.low <= float(np.mean(fresh)) <= own.high else "no"
        difference = format_difference(unpaired_difference(fresh, before))
        yield (
            f"| {value} | {name} | {limit:g} | {own.estimate:.2f} ({own.low:.2f}–{own.high:.2f}) | "
            f"{format_success(fresh)} | {within} | {difference} |"
        )


@cache
def _published() -> tuple[Point, ...]:
    return tuple(points(_atlas(), finished(_atlas(), SUMMARIES), read_agreements(SUMMARIES)))


if __name__ == "__main__":
    command(EXPERIMENT, run, tables, __doc__)
