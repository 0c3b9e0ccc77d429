"""Does a policy learn the engine? Six engines, as their users get them and matched.

    python benchmarks/tables/learned_engines.py --out runs/learned_engines
    python benchmarks/tables/learned_engines.py --out runs/learned_engines --only swing-up-matched
    python benchmarks/tables/learned_engines.py --out docs/tables/learned_engines --table

"Can RL for continuous control generalize across physics engines?" (2020, arXiv:2010.14444) reports
that policies lose in another engine than they were trained in, without seeds' intervals. An engine
is more than its equations: steps, damping, friction and limits come with it. Here policies are
trained in each of native, MuJoCo, Drake, PyBullet, DART and SAPIEN and judged in all, on the same
cart-pole, in two ways:

- `as got`: every engine with its own default step and integrator, and what its users get without
  asking. Bullet: damping 0.04 of every link, joints up to 100 rad/s and m/s. PhysX: damping 0.05 of
  every link, joint friction 0.05, links up to 10 m/s and 50 rad/s, sleep. `native`: its default
  integrator at 0.025 s, for its default of 0.02 s is no part of the control period.
- `matched`: none of these, and the same map and step: symplectic Euler at 0.01 s.

Tasks are the swing-up on the default track, with the suite's own stops at its far ends in all
engines, and on a short track, where carts run into the stops. There engines `as got` have their own
joint stops, which native has not, and `matched` the suite's own law.

Where one step of an engine is that of a map to rounding, from random states up to a tenth
beyond the stops, the fleet trains on that map: this is checked in the unit before training, and the
defect is in its rows. Where it is not (PhysX's friction, engines' own stops), stable-baselines3
trains on the engine with the same settings. Policies are judged on the engines themselves, from 20
starts of their seed's own. Engines have seeds of their own, so that equal maps are no equal
policies.

Beside a success stand what the contract check says of training's and judging's environment before
anything is integrated: boundaries that differ, and those at which one of them cannot say.

Declared before it was run, with budgets and the short track chosen on seeds 900 to 903. Two
one-sided tests for each task, corrected together by Holm's method, in which what was not run counts
as p = 1. A loss is success in the engine of training minus the mean of the five others, for every
seed the mean over engines:

1. as got there is a loss;
2. matching takes some of it away.

All else has intervals and no test.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass
from functools import cache, cached_property
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from measuring.as_got import DAMPING, FASTEST
from measuring.results import (
    correct_p_values,
    format_difference,
    format_interval,
    format_p_value,
    format_success,
    join_tables,
    markdown,
)
from measuring.tables import Cells, Row, Table, command, tabulate_blocks
from measuring.trained import (
    PACKAGES,
    STARTS,
    Act,
    count_successes,
    default_settings,
    train_by_fleet,
    train_by_sb3,
)

from integ_gym.envs.numerics.identity import IDENTICAL, cases_of, largest_error
from integ_gym.envs.numerics.stepping import one_step
from integ_gym.eval.contract import compare_contracts
from integ_gym.eval.statistics import PROVEN, Difference, mean_rate, paired_difference
from integ_gym.support.figures import axes_at, blank_figure, write_figure
from integ_gym.train.ppo import PPOConfig

ENV_ID, PERIOD, DURATION = "IntegCartPoleSwingUp-v0", 0.05, 10.0
"""Of all tasks, s; the control period is a multiple of every engine's own step."""

ARMS = ("as got", "matched")
PPO: dict[str, Any] = {
    "n_steps": 256, "batch_size": 512, "gae_lambda": 0.9, "discount_time": 1.0,
    "learning_rate": 2e-3, "learning_rate_end": 0.0,
}  # fmt: skip


@dataclass(frozen=True)
class Task:
    """What is learned.

    Attributes:
        track_limit: where the stops are, m.
        decisions: of the experience of a policy.
        touches: whether it is about the stops, so that engines have their own as got.
    """

    track_limit: float
    decisions: int
    touches: bool


TASKS = {"swing-up": Task(2.4, 400_000, False), "short track": Task(0.6, 400_000, True)}


@dataclass(frozen=True)
class Engine:
    """One of the engines.

    Attributes:
        name: of the suite's own.
        integrator: that it has by default.
        dt: that it has by default, s.
        map: native integrator that one step of it is, as got; None: no known one.
        own: class of it as got; None: as the suite has it.
        matched: its integrator that is symplectic Euler.
    """

    name: str
    integrator: str
    dt: float
    map: str | None
    matched: str
    own: str | None = None


SYMPLECTIC, MATCHED_STEP = "symplectic_euler", 0.01
ENGINES = [
    Engine("native", "rk4", 0.025, "rk4", SYMPLECTIC),
    Engine("mujoco", "Euler", 0.002, SYMPLECTIC, "Euler"),
    Engine("drake", "lagged", 0.001, SYMPLECTIC, "tamsi"),
    Engine("pybullet", "semi_implicit_euler", 1.0 / 240.0, "measuring.as_got:BulletEuler",
           "semi_implicit_euler", "measuring.as_got:Pybullet"),
    Engine("dart", "semi_implicit_euler", 0.001, SYMPLECTIC, "semi_implicit_euler"),
    Engine("sapien", "tgs", 0.01, None, "tgs", "measuring.as_got:Sapien"),
]  # fmt: skip
NAMED = {engine.name: engine for engine in ENGINES}
TESTS = ("lost as got", "lost as got − lost matched")
"""One-sided, of each task; corrected together by Holm's method."""

CASES = 200
"""States from which a step is compared with a map's."""

SEEDS = 10
"""Policies that are trained in an engine, each from a seed of its own."""

SEED_STRIDE = 100
"""From the first seed of one engine to that of the next."""


@dataclass(frozen=True)
class Unit:
    """Seeds that are trained in one engine, in one way."""

    task: str
    arm: str
    trained_on: str
    first_seed: int
    count: int

    @property
    def own_stops(self) -> bool:
        """Whether it is about each engine's own stops."""
        return self.arm == "as got" and TASKS[self.task].touches

    @property
    def _way(self) -> str:
        return f"{self.task}-{self.arm}".replace(" ", "-")

    @property
    def block(self) -> str:
        """What `--only` chooses: with its own stops, each engine alone takes up to an hour."""
        return f"{self._way}-{self.trained_on}" if self.own_stops else self._way

    @property
    def name(self) -> str:
        """Unlike that of any other."""
        return f"{self._way} on {self.trained_on}, seeds from {self.first_seed}"

    @cached_property
    def map(self) -> str | None:
        """Native integrator that the fleet trains with; None: the engine itself trains."""
        if self.arm == "matched":
            return SYMPLECTIC
        trained_itself = self.own_stops and self.trained_on != "native"
        return None if trained_itself else NAMED[self.trained_on].map


def units(first_seed: int) -> list[Unit]:
    """All, one task after the other."""
    found = []
    for task in TASKS:
        for arm in ARMS:
            for place, engine in enumerate(ENGINES):
                first = first_seed + SEED_STRIDE * place
                together = Unit(task, arm, engine.name, first, SEEDS)
                if together.map is None:
                    found += [Unit(task, arm, engine.name, first + k, 1) for k in range(SEEDS)]
                else:
                    found.append(together)
    return found


def arguments(task: str, arm: str, engine: str) -> dict[str, Any]:
    """Of the environment in an engine."""
    of, known = TASKS[task], NAMED[engine]
    common = {"control_period": PERIOD, "duration": DURATION, "track_limit": of.track_limit}
    if arm == "matched":
        return {**common, "engine": engine, "integrator": known.matched, "dt": MATCHED_STEP}
    contact = "engine" if of.touches and engine != "native" else "compliant"
    own = {"engine": known.own or engine, "integrator": known.integrator, "dt": known.dt}
    return {**common, **own, "contact": contact}


def defect(given: dict[str, Any], known: str) -> float:
    """Largest error of one step of an environment's engine against a native map's.

    Raises:
        RuntimeError: if it is beyond rounding.
    """
    with closing(gym.make(ENV_ID, **given)) as env:
        setup = env.unwrapped.setup  # type: ignore[attr-defined]
        plant, width = setup.plant, setup.engine.width
    steps = [
        one_step(name, plant, given["dt"])
        for name in (f"{given['engine']}/{given['integrator']}", f"native/{known}")
    ]
    most = 0.55 * given["track_limit"]  # cases go to ±2, so this to 1.1 times the track
    cases = [((most * q[0], q[1]), v, u) for q, v, u in cases_of(plant, True, CASES)]
    found = max(largest_error(*[step(*case) for step in steps]) for case in cases)
    if found > IDENTICAL[width]:
        raise RuntimeError(f"a step of {given} is not one of {known}: {found:g}")
    return found


@cache
def contract(task: str, arm: str, trained_on: str, judged_on: str) -> dict[str, str]:
    """Boundaries at which two environments differ, and at which one cannot say."""
    trained, judged = (arguments(task, arm, engine) for engine in (trained_on, judged_on))
    kept = ("track_limit", "duration")
    cells = [{k: v for k, v in one.items() if k not in kept} for one in (trained, judged)]
    found = compare_contracts(*cells, ENV_ID, environment={k: judged[k] for k in kept})
    return {
        "differs": ", ".join(check.boundary for check in found.broken),
        "silent": ", ".join(check.boundary for check in found.checks if not check.compared),
    }


def run(unit: Unit) -> list[Row]:
    """Contract, identity, training, and successes of a unit's policies in every engine."""
    home = arguments(unit.task, unit.arm, unit.trained_on)
    away = {engine.name: arguments(unit.task, unit.arm, engine.name) for engine in ENGINES}
    said = {name: contract(unit.task, unit.arm, unit.trained_on, name) for name in away}
    error = None if unit.map is None else defect(home, unit.map)
    seeds, begun = list(range(unit.first_seed, unit.first_seed + unit.count)), time.process_time()
    acts = _by_fleet(unit, home, seeds) if unit.map else train_by_sb3(_configs(unit, home, seeds))
    spent = (time.process_time() - begun) / unit.count
    first = unit.first_seed - unit.first_seed % SEED_STRIDE
    of = {"task": unit.task, "arm": unit.arm, "trained_on": unit.trained_on}
    return [
        {**of, "judged_on": name, "seed": seed, "run": seed - first, "successes": count,
         "starts": STARTS, "trainer": "fleet" if unit.map else "stable-baselines3",
         "defect": error, **said[name], "cpu_seconds": round(spent, 2)}
        for name, given in away.items()
        for seed, count in zip(seeds, count_successes(ENV_ID, given, acts, seeds), strict=True)
    ]  # fmt: skip


def _configs(unit: Unit, given: dict[str, Any], seeds: list[int]) -> list[PPOConfig]:
    steps = TASKS[unit.task].decisions
    return [
        PPOConfig.of(ENV_ID, seed=seed, env_arguments=given, total_steps=steps, **PPO)
        for seed in seeds
    ]


def _by_fleet(unit: Unit, home: dict[str, Any], seeds: list[int]) -> list[Act]:
    given = {**home, "engine": "native", "integrator": unit.map}
    return train_by_fleet([_configs(unit, given, seeds)], given)


TABLE = Table(
    columns={
        "task": "what is learned",
        "arm": "engines as their users get them, or matched",
        "trained_on": "engine of training",
        "judged_on": "engine of judging",
        "seed": "of training, and of the starts",
        "run": "which of its engine's seeds it is, from 0",
        "successes": "of the starts",
        "starts": "that the policy was judged from",
        "trainer": "fleet: on the map that a step of the engine is; else on the engine itself",
        "defect": "largest error of one step of the engine of training against that map",
        "differs": "boundaries of the two environments that the contract check found to differ",
        "silent": "boundaries at which one of them cannot say",
        "cpu_seconds": "processor time of the training, s",
    },
    cell=4,
    declared={
        "tasks": {name: asdict(task) for name, task in TASKS.items()},
        "engines": [asdict(engine) for engine in ENGINES],
        "matched_step": MATCHED_STEP,
        "env_id": ENV_ID,
        "control_period": PERIOD,
        "duration": DURATION,
        "bullet": {"damping": DAMPING, "fastest": FASTEST},
        "ppo": PPO,
        "defaults": {"PPO": default_settings(PPOConfig, PPO)},
        "seeds": SEEDS,
        "seed_stride": SEED_STRIDE,
        "starts": STARTS,
        "chosen_on": "seeds 900 to 903: amounts of experience, the short track",
        "tests": TESTS,
    },
    packages=(
        *PACKAGES, "stable-baselines3", "torch",
        "mujoco", "drake", "pybullet", "dartpy", "sapien",
    ),
    units=units,
    first_seed=5000,
    run=run,
)  # fmt: skip
NAMES = TABLE.cell_columns


def home_and_away(
    cells: Cells, task: str, arm: str, engine: str, among: Sequence[str] = tuple(NAMED)
) -> tuple[Any, Any]:
    """Success of an engine's policies in it, and the mean of that in the others; by seed."""
    others = [cells.rates(task, arm, engine, name) for name in among if name != engine]
    return np.array(cells.rates(task, arm, engine, engine)), np.array(others).mean(axis=0)


def is_whole(cells: Cells, task: str, arm: str) -> bool:
    """Whether all policies were run that were declared."""
    return all(len(cells.rates(task, arm, name, name)) == SEEDS for name in NAMED)


def over_engines(
    cells: Cells, task: str, arm: str, among: Sequence[str] = tuple(NAMED)
) -> tuple[Any, Any]:
    """As :func:`home_and_away`, the mean over engines."""
    pairs = [home_and_away(cells, task, arm, name, among) for name in among]
    home, away = (np.mean(side, axis=0) for side in zip(*pairs, strict=True))
    return home, away


@dataclass(frozen=True)
class Comparison:
    """A test that was declared.

    Attributes:
        name: which of `TESTS`.
        task: what was learned.
        sides: success by run, in [0, 1], of what is claimed to be higher and lower; None: not run.
        scale: what is claimed, over the difference of the sides.
    """

    name: str
    task: str
    sides: tuple[Any, Any] | None
    scale: float = 1.0

    @cached_property
    def difference(self) -> Difference | None:
        """Of the sides, with its test."""
        return None if self.sides is None else paired_difference(*self.sides)


def comparisons(cells: Cells) -> Iterator[Comparison]:
    """All tests that were declared.

    The second of a task is half the difference of the losses, so that its sides are in [0, 1].
    """
    for task in TASKS:
        sides, both = None, None
        if is_whole(cells, task, "as got"):
            sides = home, away = over_engines(cells, task, "as got")
            if is_whole(cells, task, "matched"):
                at_home, elsewhere = over_engines(cells, task, "matched")
                both = (home + elsewhere) / 2.0, (away + at_home) / 2.0
        lost, taken_away = TESTS
        yield Comparison(lost, task, sides)
        yield Comparison(taken_away, task, both, 2.0)


def lost_among(
    cells: Cells, task: str, arm: str, among: Sequence[str] = tuple(NAMED)
) -> Difference:
    """Loss in the others of some engines, the mean over engines of training."""
    return paired_difference(*over_engines(cells, task, arm, among))


def lost_in_others(cells: Cells, task: str, arm: str, engine: str) -> Difference:
    """Loss of an engine's policies in the five others."""
    return paired_difference(*home_and_away(cells, task, arm, engine))


def tables(rows: list[Row], first_seed: int = TABLE.first_seed) -> str:
    """The page's tables, as Markdown."""
    cells = Cells(rows, NAMES)
    blocks = tabulate_blocks(TABLE, rows, first_seed, "policies", lambda unit: unit.count)
    return join_tables([blocks, _tests(cells), _losses(cells), _defects(rows), *_matrices(cells)])


def _tests(cells: Cells) -> list[str]:
    found = list(comparisons(cells))
    differences = [one.difference for one in found]
    corrected = correct_p_values(differences), correct_p_values(differences, PROVEN)
    lines = []
    for one, *of_family in zip(found, *corrected, strict=True):
        if one.difference is None:
            continue
        by_run = one.scale * np.subtract(*one.sides)
        p = map(format_p_value, (one.difference.p_greater(), *of_family))
        claimed = format_difference(one.difference, one.scale)
        least, greatest = (format_interval((x, None, None)) for x in (min(by_run), max(by_run)))
        lines.append((one.name, one.task, claimed, f"{least} to {greatest}", *p))
    header = ("test", "task", "difference", "of single runs", "p", "p (Holm)", "p (Holm, Gaffke)")
    return markdown(header, lines)


def _losses(cells: Cells) -> list[str]:
    lines = []
    for task in TASKS:
        for name in NAMED:
            line = [task, name]
            for arm in ARMS:
                home = cells.rates(task, arm, name, name)
                whole = len(home) == SEEDS
                line += [format_success(home) if whole else ""]
                line += [format_difference(lost_in_others(cells, task, arm, name)) if whole else ""]
            lines.append(line)
    header = [f"{what} {arm}" for arm in ARMS for what in ("success at home", "lost elsewhere")]
    return markdown(("task", "trained on", *header), [line for line in lines if any(line[2:])])


def _ways_run(rows: list[Row]) -> list[tuple[str, str]]:
    """Tasks and arms of which there are rows, as declared."""
    there = {(row["task"], row["arm"]) for row in rows}
    return [(task, arm) for task in TASKS for arm in ARMS if (task, arm) in there]


def _defects(rows: list[Row]) -> list[str]:
    """Largest error of a step against the map that was trained on, by engine of training."""
    found = {(row["task"], row["arm"], row["trained_on"]): row["defect"] for row in rows}
    ways = _ways_run(rows)
    lines = []
    for name in NAMED:
        own = [found.get((*way, name), "") for way in ways]
        lines.append([name, *[x if x == "" else _format_defect(x) for x in own]])
    return markdown(("defect of a step of", *[f"{task}, {arm}" for task, arm in ways]), lines)


def _format_defect(error: float | None) -> str:
    if error is None:
        return "trained on it"
    return f"{error:.0e}".replace("-", "−") if error else "0"


def _matrices(cells: Cells) -> Iterator[list[str]]:
    """Trained in an engine, judged in all."""
    for task in TASKS:
        for arm in ARMS:
            lines = [
                [name, *[format_success(cells.rates(task, arm, name, other)) for other in NAMED]]
                for name in NAMED
            ]
            shown = [line for line in lines if any(line[1:])]
            yield markdown((f"{task}, {arm}: trained on", *NAMED), shown)


def figure(rows: list[Row], path: Path) -> None:
    """Mean success, by engines of training and of judging."""
    cells, shown = Cells(rows, NAMES), _ways_run(rows)
    height = 0.6 + 3.1 * -(-len(shown) // 2)
    drawn = blank_figure(6.6, height)
    for place, (task, arm) in enumerate(shown):
        across, down = place % 2, place // 2
        axes = axes_at(drawn, 0.9 + 2.9 * across, height - 2.7 - 3.1 * down, 2.3, 2.3)
        means = np.full((len(NAMED),) * 2, np.nan)
        for i, name in enumerate(NAMED):
            for j, other in enumerate(NAMED):
                if rates := cells.rates(task, arm, name, other):
                    means[i, j] = mean_rate(rates)
                    axes.text(j, i, f"{means[i, j]:.2f}", ha="center", va="center", fontsize=7)
        axes.imshow(means, vmin=0.0, vmax=1.0, cmap="Blues", alpha=0.5)
        axes.set_title(f"{task}, {arm}", fontsize=9)
        axes.set_xticks(range(len(NAMED)), list(NAMED), fontsize=7, rotation=45, ha="right")
        axes.set_yticks(range(len(NAMED)), list(NAMED) if not across else [], fontsize=7)
    drawn.text(0.02, 0.5, "trained on", rotation=90, va="center", fontsize=8)
    drawn.text(0.5, 0.02, "judged on", ha="center", fontsize=8)
    write_figure(drawn, path)


if __name__ == "__main__":
    command(TABLE, tables, __doc__, figure)
