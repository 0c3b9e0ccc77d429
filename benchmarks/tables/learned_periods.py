"""Which control period? Six tasks, five periods, PPO and SAC, judged at every period on the truth.

    python benchmarks/tables/learned_periods.py --out runs/learned_periods
    python benchmarks/tables/learned_periods.py --out runs/learned_periods --only pendulum-PPO
    python benchmarks/tables/learned_periods.py --out docs/tables/learned_periods --table

Farrahi and Mahmood (2023, arXiv:2305.05760) report that PPO and SAC with the hyperparameters of one
control period fail at others; Park, Kim and Kim (NeurIPS 2021) and Tallec, Blier and Ollivier
(2019, arXiv:1901.09732) that learning fails as the period goes to 0. Here every task is learned on
the truth, at a quarter, half, one, two and four times the period that its settings were tuned for,
by one algorithm always through the same time in s, two ways:

- `per decision`: discount, λ, length of rollouts and of batches (SAC: discount, decisions before
  learning, gradient steps for each decision) as at the tuned period;
- `per second`: the time that they span is as at the tuned period.

At the tuned period both are the same, and run once. Every policy is then judged at all five periods
on the truth, with no delay and with one of one decision, from 20 starts of its seed's own. Beside
them are the hand-made controllers, each designed for the period that it is judged at: where one
succeeds the period is possible.

Declared before it was run, with budgets chosen on seeds 900 to 903 at the tuned period alone: PPO
by the fleet with 8 seeds from 4200, SAC of stable-baselines3 with 3. Three families of one-sided
tests on PPO, corrected together by Holm's method, in which what was not run counts as p = 1:

1. `per second` is better than `per decision`, at the longest and the shortest period, no delay;
2. what was learned at the tuned period loses success at the longest and at the shortest, no delay;
3. what was learned at the tuned period loses success by a delay of one decision there.

All else, and all of SAC, has intervals and no test.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import gymnasium as gym

sys.path.insert(0, str(Path(__file__).parents[1]))

from measuring.results import (
    correct_p_values,
    format_difference,
    format_p_value,
    format_success,
    join_tables,
    markdown,
)
from measuring.tables import Cells, Row, Table, command, tabulate_blocks
from measuring.trained import (
    OUTCOME_COLUMNS,
    PACKAGES,
    STARTS,
    Act,
    count_successes,
    default_settings,
    scale_to_period,
    train_by_fleet,
    train_by_sb3,
)

from integ_gym.eval.statistics import (
    PROVEN,
    Difference,
    paired_difference,
    rate_interval,
    unpaired_difference,
)
from integ_gym.support.figures import COOL, SOFT, WARM, axes_at, blank_figure, write_figure
from integ_gym.train.baselines import make_baseline
from integ_gym.train.ppo import PPOConfig
from integ_gym.train.sac import SACConfig

SLOWER = (4.0, 2.0, 1.0, 0.5, 0.25)
"""Periods over the tuned one."""

SHARED: dict[str, Any] = {
    "n_steps": 256, "batch_size": 512, "gae_lambda": 0.9,
    "learning_rate": 2e-3, "learning_rate_end": 0.0,
}  # fmt: skip
"""PPO's, at the tuned period, of most tasks."""


@dataclass(frozen=True)
class Task:
    """What is learned.

    Attributes:
        env_id: of the environment.
        environment: its arguments.
        period: that the settings are tuned for, s.
        decisions: of PPO's experience at that period.
        discount_time: τ, s.
        ppo: PPO's other settings at that period.
        sac_decisions: of SAC's experience at that period; 0: it has no continuous actions.
    """

    env_id: str
    environment: dict[str, Any]
    period: float
    decisions: int
    discount_time: float = 1.0
    ppo: dict[str, Any] = field(default_factory=lambda: SHARED)
    sac_decisions: int = 0

    @cached_property
    def periods(self) -> tuple[float, ...]:
        """At which it is learned and judged, s."""
        return tuple(self.period * slower for slower in SLOWER)

    def arguments(self, period: float, delay: int = 0) -> dict[str, Any]:
        """Of the environment on the truth; the delay is in decisions."""
        at = {"integrator": "reference", "dt": period, "control_period": period}
        return {**self.environment, **at, "action_latency": delay * period}


PUSH = {"n_steps": 64, "batch_size": 256, "gae_lambda": 0.95, "learning_rate": 1e-3}
TASKS = {
    "pendulum": Task(
        "IntegPendulum-v0",
        {"start": "hanging", "duration": 10.0, "max_torque": 0.84},
        0.05, 300_000, sac_decisions=20_000,
    ),
    "cart-pole": Task("IntegCartPole-v0", {"duration": 10.0}, 0.02, 60_000, ppo=PUSH),
    "elastic pendulum": Task(
        "IntegElasticPendulum-v0",
        {"stiffness": 29.43, "max_force": 0.3, "duration": 15.0},
        0.05, 200_000, sac_decisions=20_000,
    ),
    "quadrotor": Task(
        "IntegQuadrotor-v0", {"duration": 10.0}, 0.04, 600_000,
        ppo={**SHARED, "log_std_init": 0.5}, sac_decisions=30_000,
    ),
    "cart-pole swing-up": Task(
        "IntegCartPoleSwingUp-v0", {"duration": 10.0}, 0.04, 400_000, sac_decisions=30_000
    ),
    "acrobot": Task(
        "IntegAcrobot-v0",
        {"duration": 30.0, "max_speed_1": None, "max_speed_2": None},
        0.2, 200_000, discount_time=10.0, ppo={**PUSH, "n_steps": 256},
    ),
}  # fmt: skip

TESTS = ("per second gains", "lost at another period", "lost by a delay")
"""One-sided, of PPO on each task; corrected together by Holm's method."""

SEEDS = {"PPO": 8, "SAC": 3, "hand-made": 8}
SEEDS_OF_UNIT = {"PPO": 8, "SAC": 1, "hand-made": 8}
"""Seeds of a unit."""

SAC_LANES, SAC_STARTS = 4, 1000
"""Environments that advance together, and decisions before learning at the tuned period."""


@dataclass(frozen=True)
class Unit:
    """Seeds of one algorithm, in one way, at one period."""

    task: str
    algorithm: str
    arm: str
    period: float
    first_seed: int

    @property
    def block(self) -> str:
        """What `--only` chooses."""
        return f"{self.task.replace(' ', '-')}-{self.algorithm}"

    @property
    def name(self) -> str:
        """Unlike that of any other."""
        return f"{self.block} {self.arm} at {self.period:g} s, seeds from {self.first_seed}"

    @property
    def seeds(self) -> range:
        """Of its policies."""
        return range(self.first_seed, self.first_seed + SEEDS_OF_UNIT[self.algorithm])


def units(first_seed: int) -> list[Unit]:
    """All, PPO first."""
    return [
        Unit(name, algorithm, arm, period, first)
        for algorithm, count in SEEDS.items()
        for name, task in TASKS.items()
        if algorithm != "SAC" or task.sac_decisions
        for first in range(first_seed, first_seed + count, SEEDS_OF_UNIT[algorithm])
        for period in task.periods
        for arm in arms(algorithm, task, period)
    ]


def arms(algorithm: str, task: Task, period: float) -> tuple[str, ...]:
    """Ways to set an algorithm at a period."""
    if algorithm == "hand-made":
        return ("designed",)
    return ("both",) if period == task.period else ("per decision", "per second")


def run(unit: Unit) -> list[Row]:
    """Successes of a unit's policies at every period, with and without a delay."""
    task, begun = TASKS[unit.task], time.process_time()
    acts = {"PPO": _by_ppo, "SAC": _by_sac, "hand-made": _by_hand}[unit.algorithm](unit, task)
    trained = time.process_time() - begun
    at = [unit.period] if unit.algorithm == "hand-made" else task.periods
    of = {**asdict(unit), "trained_at": unit.period}
    del of["period"], of["first_seed"]
    return [
        {**of, "judged_at": period, "delay": delay, "seed": seed, "successes": count,
         "starts": STARTS, "cpu_seconds": round(trained / len(unit.seeds), 2)}
        for period in at
        for delay in (0, 1)
        for seed, count in zip(
            unit.seeds,
            count_successes(task.env_id, task.arguments(period, delay), acts, list(unit.seeds)),
            strict=True,
        )
    ]  # fmt: skip


def ppo_settings(task: Task, arm: str, period: float) -> dict[str, Any]:
    """Of PPO's trainer."""
    slower = period / task.period
    common = {**task.ppo, "total_steps": round(task.decisions / slower)}
    if arm == "per decision":
        return {**common, "discount_time": task.discount_time * slower}
    return {**common, **scale_to_period(task.ppo, slower), "discount_time": task.discount_time}


def sac_settings(task: Task, arm: str, period: float) -> dict[str, Any]:
    """Of SAC's trainer: at the tuned period, a gradient step for each decision."""
    slower = period / task.period
    common = {"total_steps": round(task.sac_decisions / slower), "n_envs": SAC_LANES}
    if arm == "per decision":
        own = {"learning_starts": SAC_STARTS, "discount_time": task.discount_time * slower}
        return {**common, **own}
    return {
        **common,
        "learning_starts": round(SAC_STARTS / slower),
        "discount_time": task.discount_time,
        "train_freq": max(1, round(1.0 / slower)),
        "gradient_steps": round(SAC_LANES * max(1.0, slower)),
    }


def _by_ppo(unit: Unit, task: Task) -> list[Act]:
    given, settings = task.arguments(unit.period), ppo_settings(task, unit.arm, unit.period)
    configs = [
        PPOConfig.of(task.env_id, seed=seed, env_arguments=given, **settings) for seed in unit.seeds
    ]
    return train_by_fleet([configs], given)


def _by_sac(unit: Unit, task: Task) -> list[Act]:
    given, settings = task.arguments(unit.period), sac_settings(task, unit.arm, unit.period)
    configs = [
        SACConfig.of(task.env_id, seed=seed, env_arguments=given, **settings) for seed in unit.seeds
    ]
    return train_by_sb3(configs)


def _by_hand(unit: Unit, task: Task) -> list[Act]:
    with closing(gym.make(task.env_id, **task.arguments(unit.period))) as env:
        controller = make_baseline("handmade", env.unwrapped.setup)  # type: ignore[attr-defined]
    return [controller.act for _ in unit.seeds]


TABLE = Table(
    columns={
        "task": "what is learned",
        "algorithm": "PPO, SAC, or hand-made",
        "arm": "what stays as at the tuned period; both at that period",
        "trained_at": "control period of training, s; hand-made: of the design",
        "judged_at": "control period of judging, s",
        "delay": "of every command when judged, decisions",
        **OUTCOME_COLUMNS,
        "cpu_seconds": "processor time of the training, s",
    },
    cell=6,
    declared={
        "tasks": {name: asdict(task) for name, task in TASKS.items()},
        "slower": SLOWER,
        "seeds": SEEDS,
        "starts": STARTS,
        "sac": {"lanes": SAC_LANES, "learning_starts": SAC_STARTS},
        "defaults": {
            "PPO": default_settings(PPOConfig, (*PUSH, "discount_time")),
            "SAC": default_settings(SACConfig, ("n_envs", "learning_starts", "discount_time")),
        },
        "chosen_on": "seeds 900 to 903, at the tuned period: amounts of experience",
        "tests": TESTS,
    },
    packages=(*PACKAGES, "stable-baselines3", "torch"),
    units=units,
    first_seed=4200,
    run=run,
)
NAMES = TABLE.cell_columns


def tables(rows: list[Row], first_seed: int = TABLE.first_seed) -> str:
    """The page's tables, as Markdown."""
    cells = Cells(rows, NAMES)
    blocks = tabulate_blocks(TABLE, rows, first_seed, "units", lambda unit: 1)
    return join_tables([blocks, _own_period(cells), _tests(cells), *_matrices(cells)])


def _rates(
    cells: Cells, task: str, algorithm: str, arm: str, period: float, **at: Any
) -> list[float]:
    """Success rates of seeds, judged at the period of training unless another is named."""
    arm = "both" if period == TASKS[task].period and algorithm != "hand-made" else arm
    judged, delay = at.get("judged_at", period), at.get("delay", 0)
    return cells.rates(task, algorithm, arm, period, judged, delay)


COLUMNS = (
    *((algorithm, arm) for algorithm in ("PPO", "SAC") for arm in ("per decision", "per second")),
    ("hand-made", "designed"),
)


def _own_period(cells: Cells) -> list[str]:
    lines = [
        [
            name,
            f"{period:g}",
            *[format_success(_rates(cells, name, *column, period)) for column in COLUMNS],
        ]
        for name, task in TASKS.items()
        for period in task.periods
    ]
    names = [f"{algorithm} {arm}" for algorithm, arm in COLUMNS[:-1]]
    shown = [line for line in lines if any(line[2:])]
    return markdown(("task", "period, s", *names, "hand-made"), shown)


def comparisons(cells: Cells) -> Iterator[tuple[str, str, float, Difference | None]]:
    """All tests that were declared: family, task, period in s, difference; None: not run."""
    gains, moved, late = TESTS
    for name, task in TASKS.items():
        longest, *_, shortest = task.periods
        for period in (longest, shortest):
            pair = [
                _rates(cells, name, "PPO", arm, period) for arm in ("per second", "per decision")
            ]
            difference = unpaired_difference(*pair) if all(pair) else None
            yield gains, name, period, difference
        home = _rates(cells, name, "PPO", "both", task.period)
        for family, period, at in (
            (moved, longest, {"judged_at": longest}),
            (moved, shortest, {"judged_at": shortest}),
            (late, task.period, {"delay": 1}),
        ):
            away = _rates(cells, name, "PPO", "both", task.period, **at)
            yield family, name, period, paired_difference(home, away) if home and away else None


def _tests(cells: Cells) -> list[str]:
    found = list(comparisons(cells))
    differences = [one for *_, one in found]
    corrected = correct_p_values(differences), correct_p_values(differences, PROVEN)
    lines = [
        (family, name, f"{period:g}", format_difference(one), *map(format_p_value, p))
        for (family, name, period, one), *p in zip(found, *corrected, strict=True)
        if one is not None
    ]
    header = ("test", "task", "period, s", "difference", "p (Holm)", "p (Holm, Gaffke)")
    return markdown(header, lines)


def _matrices(cells: Cells) -> Iterator[list[str]]:
    """Learned at a period, judged at all: PPO `per second`, without and with a delay.

    Last of each task, what the hand-made controllers reach, each at the period of its design.
    """
    judged = [f"{slower:g} × tuned" for slower in SLOWER]
    for delay, what in ((0, "no delay"), (1, "delay of one decision")):
        lines = []
        for name, task in TASKS.items():
            for period in task.periods:
                own = [
                    _rates(cells, name, "PPO", "per second", period, judged_at=at, delay=delay)
                    for at in task.periods
                ]
                lines.append([name, f"{period:g}", *map(format_success, own)])
            own = [_rates(cells, name, *COLUMNS[-1], at, delay=delay) for at in task.periods]
            lines.append([name, "hand-made", *map(format_success, own)])
        lines = [line for line in lines if any(line[2:])]
        yield markdown((f"task, {what}", "learned at, s", *judged), lines)


APART_IN_FIGURE = 1.07
"""Factor between the places of two columns at one period, so that their intervals are seen."""


def figure(rows: list[Row], path: Path) -> None:
    """Success at the period of training, by task."""
    cells, run = Cells(rows, NAMES), {row["task"] for row in rows}
    shown = [(name, task) for name, task in TASKS.items() if name in run]
    height = 0.5 + 2.55 * -(-len(shown) // 3)
    drawn = blank_figure(9.0, height)
    looks = {("PPO", "per decision"): (WARM, "-", "o"), ("PPO", "per second"): (COOL, "-", "o"),
             ("SAC", "per decision"): (WARM, ":", "^"), ("SAC", "per second"): (COOL, ":", "^"),
             ("hand-made", "designed"): (SOFT, "--", "_")}  # fmt: skip
    for place, (name, task) in enumerate(shown):
        across, down = place % 3, place // 3
        axes = axes_at(drawn, 0.6 + 2.85 * across, height - 2.2 - 2.55 * down, 2.4, 1.85)
        for k, (column, (colour, line, marker)) in enumerate(looks.items()):
            beside = APART_IN_FIGURE ** (k - 2)
            found = [(at * beside, _rates(cells, name, *column, at)) for at in task.periods]
            label = " ".join(column).removesuffix(" designed")
            _draw(axes, [one for one in found if one[1]], label, colour, line, marker)
        axes.set_title(name, fontsize=9)
        axes.set(xscale="log", ylim=(-0.04, 1.04))
        axes.set_xticks(task.periods, [f"{period:g}" for period in task.periods], fontsize=7)
        axes.minorticks_off()
        axes.tick_params(axis="y", labelsize=7)
        if place + 3 >= len(shown):
            axes.set_xlabel("control period, s", fontsize=8)
        if not across:
            axes.set_ylabel("success on the truth", fontsize=8)
    handles, labels = drawn.axes[0].get_legend_handles_labels()
    drawn.legend(handles, labels, loc="lower center", ncols=5, fontsize=8, frameon=False)
    write_figure(drawn, path)


def _draw(
    axes: Any,
    found: Sequence[tuple[float, list[float]]],
    label: str,
    colour: str,
    line: str,
    marker: str,
) -> None:
    ends = [(at, rate_interval(rates)) for at, rates in found]
    if not ends:
        return
    axes.plot(
        [at for at, _ in ends], [one.estimate for _, one in ends],
        line, color=colour, label=label, marker=marker, markersize=3.5, linewidth=1.2,
    )  # fmt: skip
    for at, one in ends:
        axes.plot([at, at], [one.low, one.high], color=colour, linewidth=0.8)


if __name__ == "__main__":
    command(TABLE, tables, __doc__, figure)
