"""Policies that a table compares: trained side by side, and judged from starts of their own."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import closing
from dataclasses import MISSING, dataclass, fields
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import gymnasium as gym
import numpy as np

from integ_gym.train import ppo, sac
from integ_gym.train.config import TrainingConfig
from integ_gym.train.fleet.training import train_in_stages
from integ_gym.train.policy_files.sidecar import actor_of, read_trained
from integ_gym.train.ppo import PPOConfig

STARTS = 20
"""That every policy is judged from."""

TOGETHER = 8
"""Seeds that are trained at once."""

PACKAGES = ("integ-gym", "numpy", "jax", "jaxlib")
"""Of an experiment whose policies the fleet trains."""

OUTCOME_COLUMNS = {
    "seed": "of training, and of the starts",
    "successes": "of the starts",
    "starts": "that the policy was judged from",
}
"""What the columns of a cohort's rows mean, behind those of its cell."""

Act = Callable[[Any], Any]
"""A policy: observations to actions, of all lanes at once."""


@dataclass(frozen=True)
class Cohort:
    """Seeds of one cell of a table that one process trains.

    Attributes:
        cell: the columns that say what it is, to their values.
        first_seed: of `TOGETHER`.
    """

    cell: Mapping[str, Any]
    first_seed: int

    @property
    def block(self) -> str:
        """What `--only` chooses: the cells of one value of the first column."""
        column, value = next(iter(self.cell.items()))
        return f"{column}-{value}"

    @property
    def name(self) -> str:
        """Unlike that of any other."""
        cell = ", ".join(f"{column} {value}" for column, value in self.cell.items())
        return f"{cell}, seeds from {self.first_seed}"

    @property
    def seeds(self) -> range:
        """Of its policies."""
        return range(self.first_seed, self.first_seed + TOGETHER)

    def rows(self, successes: Sequence[int]) -> list[dict[str, Any]]:
        """Of its table, from the successes of its policies."""
        return [
            {**self.cell, "seed": seed, "successes": count, "starts": STARTS}
            for seed, count in zip(self.seeds, successes, strict=True)
        ]


def cohorts(cells: Sequence[Mapping[str, Any]], seeds: range) -> list[Cohort]:
    """All of some cells, the first seeds of every cell first.

    Args:
        cells: as a cohort has them.
        seeds: of each cell, a multiple of `TOGETHER`.
    """
    return [Cohort(cell, first) for first in seeds[::TOGETHER] for cell in cells]


OF_THE_EXPERIMENT = ("env_id", "seed", "total_steps")
"""Fields of a configuration that an experiment always sets."""


def default_settings(config: type[TrainingConfig], stated: Iterable[str]) -> dict[str, Any]:
    """An algorithm's hyperparameters that an experiment leaves at their defaults.

    Args:
        config: of the algorithm.
        stated: names of those that the experiment sets.
    """
    replaced = (*OF_THE_EXPERIMENT, *stated)
    return {
        one.name: one.default
        for one in fields(config)
        if one.default is not MISSING and one.name not in replaced
    }


def scale_to_period(at_home: Mapping[str, Any], slower: float) -> dict[str, Any]:
    """PPO's settings, so that rollouts, minibatches and λ span the time that they do at home.

    Args:
        at_home: `n_steps`, `batch_size`, `gae_lambda`, and others that stay.
        slower: control period over that at home.
    """
    counted = {name: round(at_home[name] / slower) for name in ("n_steps", "batch_size")}
    return {**at_home, **counted, "gae_lambda": math.pow(at_home["gae_lambda"], slower)}


def train_and_count_successes(
    stages: Sequence[Sequence[PPOConfig]], judged: Mapping[str, Any]
) -> list[int]:
    """Successes of each policy that the fleet trains, from `STARTS` starts of its seed's own.

    Args:
        stages: how they are trained, one stage after the other.
        judged: arguments of the environment that they are judged in.
    """
    last = stages[-1]
    acts = train_by_fleet(stages, judged)
    return count_successes(last[0].env_id, judged, acts, [config.seed for config in last])


def train_by_fleet(stages: Sequence[Sequence[PPOConfig]], given: Mapping[str, Any]) -> list[Act]:
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


def train_by_sb3(configs: Sequence[TrainingConfig]) -> list[Act]:
    """Policies that stable-baselines3 trains one after the other, in the order of configurations.

    Args:
        configs: of each, by PPO or SAC.
    """
    acts: list[Act] = []
    for config in configs:
        make_model = sac.make_model if isinstance(config, sac.SACConfig) else ppo.make_model
        with TemporaryDirectory() as folder:
            trained = ppo.train_run(config, Path(folder), make_model=make_model)
            acts.append(read_trained(trained.policy)[0].act)
    return acts


def count_successes(
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
