"""Does learning by values alone fail as the control period goes to 0?

    python benchmarks/tables/q_learning_periods.py --out runs/q_learning_periods
    python benchmarks/tables/q_learning_periods.py --out runs/q_learning_periods --only period-0.02
    python benchmarks/tables/q_learning_periods.py --out docs/tables/q_learning_periods --table

Tallec, Blier and Ollivier (2019, *Making deep Q-learning methods robust to time discretization*,
arXiv:1901.09732) prove that the value of an action tends to the value of its state as the period
goes to 0, because one period decides ever less, and report that Q-learning fails there. Here DQN of
stable-baselines3 learns to balance the cart-pole, through the same 1000 s at every period, with
PPO beside it, which learns by advantages. Discount, replay memory and the time between two updates
span the same time at every period, and PPO's rollouts, minibatches and λ do. DQN's minibatches are
64 decisions and its random actions last one, whatever the period. Settings of DQN are those that
rl-baselines3-zoo publishes for `CartPole-v1`, at 0.02 s, but for 8 lanes and RK4.

Declared before it was run: three periods, seeds 2900 to 2907, 20 starts each, success is to balance
for 10 s. The trend is reproduced where, at the shortest period, PPO is better than DQN, and DQN is
worse than at 0.02 s: two one-sided tests, corrected by Holm's method. What lies between is
printed without a test.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping
from contextlib import closing
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
    count_successes,
    scale_to_period,
    train_and_count_successes,
)

from integ_gym.eval.statistics import Difference, unpaired_difference
from integ_gym.train.ppo import PPOConfig

ENV_ID = "IntegCartPole-v0"
ENVIRONMENT: dict[str, Any] = {"integrator": "rk4", "duration": 10.0}
PERIOD = 0.02
"""That the settings were published for, s."""

SECONDS = 1000.0
"""Of experience, of all environments together."""

DISCOUNT_TIME = 2.0
"""s: a discount of 0.99 at `PERIOD`."""

LANES = 8
DQN: dict[str, Any] = {
    "learning_rate": 2.3e-3, "batch_size": 64, "buffer_size": 100_000, "learning_starts": 1000,
    "target_update_interval": 10, "train_freq": 256, "gradient_steps": 128,
    "exploration_fraction": 0.16, "exploration_final_eps": 0.04, "net_arch": [256, 256],
}  # fmt: skip
"""At `PERIOD`."""

COUNTED = ("buffer_size", "learning_starts", "target_update_interval", "train_freq")
"""Of these, in decisions: they follow the time that they span there."""
PPO: dict[str, Any] = {"n_envs": 8, "n_steps": 64, "batch_size": 128, "gae_lambda": 0.9}
"""At `PERIOD`; rollouts, batches and λ follow the time."""

PERIODS = (0.02, 0.005, 0.00125)
"""s."""

ALGORITHMS = ("DQN", "PPO")
SEEDS = 8
"""Of each algorithm at each period."""


def arguments(period: float) -> dict[str, Any]:
    """Of the environment."""
    return {**ENVIRONMENT, "dt": period, "control_period": period}


def units(first_seed: int) -> list[Cohort]:
    """All there are."""
    cells = [{"period": period, "algorithm": name} for period in PERIODS for name in ALGORITHMS]
    return cohorts(cells, range(first_seed, first_seed + SEEDS))


def run(unit: Cohort) -> list[Row]:
    """Successes of each of a unit's policies."""
    period = unit.cell["period"]
    if unit.cell["algorithm"] == "PPO":
        return unit.rows(_by_advantages(unit.seeds, period))
    return unit.rows([_by_values(seed, period) for seed in unit.seeds])


def _by_advantages(seeds: range, period: float) -> list[int]:
    """Successes of policies of PPO."""
    given = arguments(period)
    settings = {
        **scale_to_period(PPO, period / PERIOD),
        "total_steps": round(SECONDS / period),
        "discount_time": DISCOUNT_TIME,
    }
    configs = [PPOConfig.of(ENV_ID, seed=seed, env_arguments=given, **settings) for seed in seeds]
    return train_and_count_successes([configs], given)


def _by_values(seed: int, period: float) -> int:
    """Successes of one policy of stable-baselines3's DQN."""
    import gymnasium as gym
    import torch
    from gymnasium.vector import AutoresetMode
    from stable_baselines3 import DQN as Learner

    from integ_gym.train.vec_env import Sb3VecEnv

    torch.set_num_threads(1)
    given = arguments(period)
    mode = AutoresetMode.SAME_STEP
    settings = {**DQN, "gamma": math.exp(-period / DISCOUNT_TIME)}
    settings |= {name: round(DQN[name] * PERIOD / period) for name in COUNTED}
    settings["train_freq"] //= LANES  # is counted in steps of all lanes
    net = {"net_arch": settings.pop("net_arch")}
    made = gym.make_vec(ENV_ID, num_envs=LANES, autoreset_mode=mode, **given)
    with closing(Sb3VecEnv(made)) as envs:
        model = Learner("MlpPolicy", envs, seed=seed, device="cpu", policy_kwargs=net, **settings)
        model.learn(round(SECONDS / period))
    (found,) = count_successes(
        ENV_ID, given, [lambda seen: model.predict(seen, deterministic=True)[0]], [seed]
    )
    return found


TESTS = (
    f"PPO less DQN, both at {min(PERIODS):g} s",
    f"DQN at {PERIOD:g} s less DQN at {min(PERIODS):g} s",
)

TABLE = Table(
    columns={
        "period": "control period, s",
        "algorithm": "DQN or PPO",
        **OUTCOME_COLUMNS,
    },
    cell=2,
    declared={
        "env_id": ENV_ID,
        "environment": ENVIRONMENT,
        "periods": PERIODS,
        "algorithms": ALGORITHMS,
        "seeds": SEEDS,
        "published_for": PERIOD,
        "seconds": SECONDS,
        "discount_time": DISCOUNT_TIME,
        "lanes": LANES,
        "DQN": DQN,
        "PPO": PPO,
        "starts": STARTS,
        "tests": TESTS,
    },
    packages=(*PACKAGES, "stable-baselines3", "torch"),
    units=units,
    first_seed=2900,
    run=run,
)


def tables(rows: list[Row], first_seed: int = TABLE.first_seed) -> str:
    """Success with 95 % intervals, and both tests, as Markdown."""
    return tabulate_success(
        TABLE, rows, first_seed, "control period, s", PERIODS, ALGORITHMS, _tests
    )


def _tests(cells: Cells) -> list[str]:
    compared = comparisons(cells)
    corrected = correct_p_values(compared.values())
    lines = [
        (what, format_difference(one), format_p_value(p))
        for (what, one), p in zip(compared.items(), corrected, strict=True)
    ]
    return markdown(("compared", "difference", "p (Holm)"), lines)


def comparisons(cells: Cells) -> Mapping[str, Difference]:
    """Both that were declared, by what they are."""
    shortest = min(PERIODS)
    at_home, values, advantages = (
        cells.rates(*cell) for cell in ((PERIOD, "DQN"), (shortest, "DQN"), (shortest, "PPO"))
    )
    pairs = ((advantages, values), (at_home, values))
    return {test: unpaired_difference(*pair) for test, pair in zip(TESTS, pairs, strict=True)}


if __name__ == "__main__":
    command(TABLE, tables, __doc__)
