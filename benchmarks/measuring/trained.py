"""Experiments that train policies: units of several seeds, run in processes, kept in a file."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import closing
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from tqdm import tqdm

from integ_gym.support.files import replace_file
from integ_gym.support.processes import cores
from integ_gym.train.fleet.training import preparation, train_in_stages
from integ_gym.train.policy_files.sidecar import actor_of
from integ_gym.train.ppo import PPOConfig

from . import results

STARTS = 20
"""That every policy is judged from."""

TOGETHER = 8
"""Seeds that are trained at once."""

PACKAGES = ("integ-gym", "numpy", "jax", "jaxlib")
"""Of an experiment whose policies the fleet trains."""

Done = dict[str, list[int]]
"""Successes of the seeds of a unit, by its name."""

Act = Callable[[Any], Any]
"""A policy: observations to actions, of all lanes at once."""


@dataclass(frozen=True)
class Unit:
    """What one process does at a time: seeds of one arm at one value."""

    value: float
    arm: str
    first_seed: int

    @property
    def name(self) -> str:
        """Its key in the file."""
        return f"{self.arm} at {self.value:g}, seeds from {self.first_seed}"

    @property
    def seeds(self) -> range:
        """Of its policies."""
        return range(self.first_seed, self.first_seed + TOGETHER)


@dataclass(frozen=True)
class Experiment:
    """Arms that are compared with each other at several values.

    Attributes:
        values: of what is varied.
        arms: names.
        seeds: of every arm at every value, a multiple of `TOGETHER`.
        settings: all else that decides an outcome, as JSON has it.
        packages: whose versions are recorded.
    """

    values: tuple[float, ...]
    arms: tuple[str, ...]
    seeds: range
    settings: Mapping[str, Any]
    packages: tuple[str, ...] = PACKAGES

    def units(self) -> list[Unit]:
        """All there are, the first seeds of all arms first."""
        return [
            Unit(value, arm, first)
            for first in self.seeds[::TOGETHER]
            for value in self.values
            for arm in self.arms
        ]

    def complete(self, done: Done) -> bool:
        """Whether all was run that was declared, so that its tests are those."""
        return all(unit.name in done for unit in self.units())

    def rates(self, done: Done, value: float, arm: str) -> list[float]:
        """Success rate of every seed that was run."""
        own = [unit for unit in self.units() if (unit.value, unit.arm) == (value, arm)]
        return [count / STARTS for unit in own for count in done.get(unit.name, [])]

    def run_missing(self, run: Callable[[Unit], list[int]], path: Path, workers: int) -> None:
        """Run what the file has not; each unit is written as it is done.

        Raises:
            ValueError: if the file is of other settings, versions or another processor.
        """
        self._check(path)
        done = read(path)
        left = [unit for unit in self.units() if unit.name not in done]
        pool = ProcessPoolExecutor(workers, get_context("spawn"), preparation("cpu"), (0,))
        with pool, tqdm(total=len(left), unit="unit") as bar:
            futures = {pool.submit(run, unit): unit for unit in left}
            try:
                for future in as_completed(futures):
                    done[futures[future].name] = future.result()
                    self._write(done, path)
                    bar.update()
            except BaseException:
                pool.shutdown(cancel_futures=True)
                raise

    def about(self) -> dict[str, Any]:
        """What the outcomes of one file have in common."""
        settings = {**self.settings, "starts": STARTS}
        return {
            "settings": json.loads(json.dumps(settings)),
            **results.made_with(self.packages),
        }

    def _check(self, path: Path) -> None:
        if not path.exists():
            return
        found = json.loads(path.read_text(encoding="utf-8"))
        for name, value in self.about().items():
            if found[name] != value:
                raise ValueError(
                    f"{path} was made with other {name.replace('_', ' ')}: {found[name]}, now "
                    f"{value}; give another file with --out"
                )

    def _write(self, done: Done, path: Path) -> None:
        names = [unit.name for unit in self.units() if unit.name in done]
        lines = ",\n".join(f"  {json.dumps(name)}: {done[name]}" for name in names)
        about = json.dumps(self.about(), indent=1).removesuffix("\n}")
        replace_file(path, f'{about},\n "successes": {{\n{lines}\n }}\n}}\n'.encode())

    def tables(self, done: Done, what: str, tests: Callable[[], list[str]]) -> str:
        """Success, and the tests that were declared where all was run that they are of.

        Args:
            done: what was run.
            what: is varied.
            tests: lines of their table.
        """
        lines = self._success(done, what)
        if self.complete(done):
            lines += ["", *tests()]
        return "\n".join(lines) + "\n"

    def _success(self, done: Done, what: str) -> list[str]:
        """With 95 % intervals over seeds, as Markdown; empty: not run."""
        rows = (
            [
                f"{value:g}",
                *[results.format_success(self.rates(done, value, arm)) for arm in self.arms],
            ]
            for value in self.values
        )
        return results.markdown([what, *self.arms], rows)


def read(path: Path) -> Done:
    """Successes by unit, of a file that need not be there."""
    if not path.exists():
        return {}
    found: Done = json.loads(path.read_text(encoding="utf-8"))["successes"]
    return found


def in_the_same_time(at_home: Mapping[str, Any], slower: float) -> dict[str, Any]:
    """PPO's settings, so that rollouts, minibatches and λ span the time that they do at home.

    Args:
        at_home: `n_steps`, `batch_size`, `gae_lambda`, and others that stay.
        slower: control period over that at home.
    """
    counted = {name: round(at_home[name] / slower) for name in ("n_steps", "batch_size")}
    return {**at_home, **counted, "gae_lambda": math.pow(at_home["gae_lambda"], slower)}


def by_fleet(stages: Sequence[Sequence[PPOConfig]], judged: Mapping[str, Any]) -> list[int]:
    """Successes of each policy that the fleet trains, from `STARTS` starts of its seed's own.

    Args:
        stages: how they are trained, one stage after the other.
        judged: arguments of the environment that they are judged in.
    """
    last = stages[-1]
    acts = trained_by_fleet(stages, judged)
    return judged_in(last[0].env_id, judged, acts, [config.seed for config in last])


def trained_by_fleet(stages: Sequence[Sequence[PPOConfig]], given: Mapping[str, Any]) -> list[Act]:
    """Policies that the fleet trains, in the order of a stage's configurations.

    Args:
        stages: how they are trained, one stage after the other.
        given: arguments of an environment with their actions.
    """
    last = stages[-1]
    with closing(gym.make(last[0].env_id, **given)) as env:
        space = env.action_space
    return [
        actor_of(outcome.weights, len(config.net_arch), config.activation, space).act
        for config, outcome in zip(last, train_in_stages(stages), strict=True)
    ]


def judged_in(
    env_id: str, judged: Mapping[str, Any], acts: Sequence[Act], seeds: Sequence[int]
) -> list[int]:
    """Successes of policies side by side, each from `STARTS` starts of its seed's own.

    Args:
        env_id: of the environment.
        judged: its arguments.
        acts: of each policy.
        seeds: that they were trained with.
    """
    starts = [1_000_000 + STARTS * seed + k for seed in seeds for k in range(STARTS)]
    envs = gym.make_vec(env_id, num_envs=len(starts), **judged)
    observed, _ = envs.reset(seed=starts)
    succeeded = ended = np.zeros(len(starts), dtype=bool)
    while not ended.all():
        parts = zip(acts, np.split(observed, len(acts)), strict=True)
        actions = np.concatenate([act(part) for act, part in parts])
        observed, _, terminated, truncated, info = envs.step(actions)
        ending = (terminated | truncated) & ~ended
        succeeded = succeeded | (ending & info["success"])
        ended = ended | ending
    envs.close()
    found: list[int] = succeeded.reshape(len(acts), STARTS).sum(axis=1).tolist()
    return found


def command(
    experiment: Experiment,
    run: Callable[[Unit], list[int]],
    tables: Callable[[Done], str],
    what: str | None,
) -> None:
    """Run what is missing, and print what was found.

    Args:
        experiment: what is compared.
        run: one unit.
        tables: of what was found, as Markdown.
        what: the script's docstring.
    """
    parser = results.parser(what)
    parser.add_argument("--out", type=Path, required=True, metavar="FILE", help="JSON of successes")
    parser.add_argument("--table", action="store_true", help="run nothing: print the tables")
    parser.add_argument("--workers", type=int, default=cores(), metavar="N", help="processes")
    given = parser.parse_args()
    if not given.table:
        experiment.run_missing(run, given.out, given.workers)
    print(tables(read(given.out)), end="")
