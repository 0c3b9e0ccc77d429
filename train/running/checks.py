"""What the values of a training run's hyperparameters may be."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import fields
from typing import TYPE_CHECKING, Any

from integ_gym.support.parameters import nonnegative, unknown_name

if TYPE_CHECKING:
    from ..ppo import PPOConfig


def whole(least: int, most: float = math.inf) -> Callable[[Any], str | None]:
    """A whole number of at least ``least`` and at most ``most``."""
    limits = f"{least} or above" if most == math.inf else f"from {least} to {most}"

    def check_whole(value: Any) -> str | None:
        fits = isinstance(value, int) and not isinstance(value, bool) and least <= value <= most
        return None if fits else f"must be a whole number, {limits}"

    return check_whole


def fraction(value: Any) -> str | None:
    """A number in [0, 1]."""
    return None if nonnegative(value) is None and value <= 1 else "must be a number from 0 to 1"


LONGEST = 10**12
"""Decisions of a training run, at most: at the trainers' speed, months of one core."""

MOST_LANES = 1 << 16
"""Environments that advance together, at most."""

LARGEST_ROLLOUT = 1 << 24
"""Decisions that are kept between two updates, at most: about a gigabyte."""

WIDEST, DEEPEST = 4096, 16
"""Units in a hidden layer, and hidden layers, at most."""


def layer_sizes(value: Any) -> str | None:
    """Sizes of layers."""
    fits = isinstance(value, tuple) and all(whole(1, WIDEST)(size) is None for size in value)
    if fits and len(value) <= DEEPEST:
        return None
    return f"must be a list of at most {DEEPEST} whole numbers, from 1 to {WIDEST}"


def named_values(value: Any) -> str | None:
    """A mapping from names."""
    fits = isinstance(value, Mapping) and all(isinstance(name, str) for name in value)
    return None if fits else "must map argument names to values"


ENV_ARGUMENTS = {
    "unit": "",
    "meaning": "constructor arguments, `mixture` among them; those left out take the environment's "
    "defaults",
    "check": named_values,
}
"""Of the hyperparameter that holds what the environment is made with."""


def check_names(owner: type[Any], names: Iterable[str]) -> None:
    """Check that all names are hyperparameters.

    Raises:
        TypeError: for another, with the nearest.
    """
    known = [f.name for f in fields(owner)]
    for name in names:
        if name not in known:
            raise TypeError(unknown_name("hyperparameter", name, known))


def check_rollout(config: PPOConfig) -> None:
    """Check that rollouts can be kept, and split into batches.

    Raises:
        ValueError: for an impossible value, in one sentence.
    """
    if config.rollout > LARGEST_ROLLOUT:
        raise ValueError(
            f"a rollout of `n_envs` × `n_steps` = {config.n_envs} × {config.n_steps} decisions is "
            f"kept in memory, and at most {LARGEST_ROLLOUT} are; give fewer"
        )
    if config.rollout % config.batch_size:
        raise ValueError(
            f"`batch_size`={config.batch_size} does not divide a rollout of `n_envs` × `n_steps` "
            f"= {config.rollout} decisions; give a divisor, such as "
            f"{_nearest_divisor(config.rollout, config.batch_size)}"
        )


def _nearest_divisor(whole: int, wanted: int) -> int:
    """The divisor of ``whole`` whose ratio to ``wanted`` is nearest to 1."""
    divisors = [n for n in range(1, whole + 1) if whole % n == 0]
    return min(divisors, key=lambda n: abs(math.log(n / wanted)))
