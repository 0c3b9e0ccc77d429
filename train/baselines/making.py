"""Baselines by name."""

from __future__ import annotations

from typing import Any

import numpy as np

from integ_gym.envs import Setup
from integ_gym.support import unknown_name

from ..policy import Policy
from .handmade import HANDMADE, controller_classes
from .random_policy import RandomPolicy
from .zero_policy import ZeroPolicy

BASELINES = ("random", "zero", "handmade")
"""Names that `make_baseline` takes, for every environment."""


def make_baseline(name: str, setup: Any, *, seed: int = 0, controller: str | None = None) -> Policy:
    """A baseline controller for an environment.

    Args:
        name: one of `BASELINES`.
        setup: of the environment, such as ``env.unwrapped.setup``: random and zero are made from
            its action space alone. The hand-made controller is designed for its plant, limits and
            control period, never for its integrator; latency, noise and fallback are not
            compensated.
        seed: of `random`.
        controller: of `handmade`, a registered name or ``"module:Class"``, made from the setup;
            None: the one that is for the setup's task.

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
        return RandomPolicy(setup.action_space, seed)
    if name == "zero":
        return ZeroPolicy(setup.action_space)
    return _handmade(setup, controller)


def possible_baselines(setup: Any, controller: str | None = None) -> tuple[str, ...]:
    """Names of the baselines that can be made for an environment; see `make_baseline`."""
    return tuple(name for name in BASELINES if _can_be_made(name, setup, controller))


def has_handmade(setup: Setup) -> bool:
    """Whether there is a hand-made controller for the environment's task."""
    return any(isinstance(setup.task, made.task) for made in controller_classes())


def _can_be_made(name: str, setup: Any, controller: str | None) -> bool:
    try:
        make_baseline(name, setup, controller=controller)
    except ValueError:
        return False
    return True


def _handmade(setup: Any, controller: str | None) -> Policy:
    """The hand-made controller of that name, or of the environment's task."""
    if setup.arguments().get("gravity") == 0.0:
        raise ValueError("without gravity there is nothing to balance; leave `handmade` out")
    if controller is not None:
        named: Policy = HANDMADE.load(controller)(setup)
        return named
    for made in controller_classes():
        if isinstance(setup.task, made.task):
            return made(setup)
    raise ValueError(
        f"there is no hand-made controller for the task {type(setup.task).__name__}, only for "
        f"{', '.join(made.task.__name__ for made in controller_classes())}; leave `handmade` out"
    )
