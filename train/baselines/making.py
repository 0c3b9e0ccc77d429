"""Baselines by name."""

from __future__ import annotations

import numpy as np

from integ_gym.envs.parameters import unknown_name
from integ_gym.envs.settings import Setup
from integ_gym.train.baselines.handmade import controller_classes
from integ_gym.train.baselines.random_policy import RandomPolicy
from integ_gym.train.baselines.zero_policy import ZeroPolicy
from integ_gym.train.policy.interface import Policy

BASELINES = ("random", "zero", "handmade")
"""Names that `make_baseline` takes, for every environment."""


def make_baseline(name: str, setup: Setup, *, seed: int = 0) -> Policy:
    """A baseline controller for an environment.

    Args:
        name: one of `BASELINES`.
        setup: ``env.unwrapped.setup``. The controller is designed for its plant, limits and control
            period, never for its integrator; latency, noise and fallback are not compensated.
        seed: of `random`.

    Raises:
        ValueError: for an unknown name, a plant whose parameters differ between lanes, or, of
            `handmade`, an environment that has none or whose gravity is 0.
    """
    if name not in BASELINES:
        raise ValueError(unknown_name("baseline", name, BASELINES))
    varied = [key for key, value in setup.arguments().items() if isinstance(value, np.ndarray)]
    if varied:
        raise ValueError(
            f"a baseline is made for one plant, and {', '.join(varied)} has one value per lane; "
            "make one baseline per value"
        )
    if name == "random":
        return RandomPolicy(setup, seed)
    if name == "zero":
        return ZeroPolicy(setup)
    return _handmade(setup)


def possible_baselines(setup: Setup) -> tuple[str, ...]:
    """Names of the baselines that can be made for an environment."""
    return tuple(name for name in BASELINES if _can_be_made(name, setup))


def has_handmade(setup: Setup) -> bool:
    """Whether there is a hand-made controller for the environment's task."""
    return any(isinstance(setup.task, made.task) for made in controller_classes())


def _can_be_made(name: str, setup: Setup) -> bool:
    try:
        make_baseline(name, setup)
    except ValueError:
        return False
    return True


def _handmade(setup: Setup) -> Policy:
    """The hand-made controller of the environment's task."""
    if setup.arguments().get("gravity") == 0.0:
        raise ValueError("without gravity there is nothing to balance; leave `handmade` out")
    for made in controller_classes():
        if isinstance(setup.task, made.task):
            return made(setup)
    raise ValueError(
        f"there is no hand-made controller for the task {type(setup.task).__name__}, only for "
        f"{', '.join(made.task.__name__ for made in controller_classes())}; leave `handmade` out"
    )
