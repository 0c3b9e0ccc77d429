"""Baselines by name."""

from __future__ import annotations

from contextlib import suppress
from typing import Any

import numpy as np

from integ_gym.envs.registries import TASKS
from integ_gym.envs.settings import Setup
from integ_gym.support.parameters import unknown_name
from integ_gym.support.registry import Registry

from ..policy.interface import Policy
from .random_policy import RandomPolicy
from .zero_policy import ZeroPolicy

_HANDMADE = "integ_gym.train.baselines.handmade"

BASELINES = ("random", "zero", "handmade")
"""Names that `make_baseline` takes, for every environment."""

HANDMADE = Registry(
    "hand-made controller",
    "act",
    {
        "cart_pole_balance": f"{_HANDMADE}.cart_pole_balance:BangBangRegulator",
        "cart_pole_swing_up": f"{_HANDMADE}.cart_pole_swing_up:CartPoleEnergyShaping",
        "elastic_pendulum_quiet": f"{_HANDMADE}.elastic_pendulum_quiet:SwingRegulator",
        "pendulum_swing_up": f"{_HANDMADE}.pendulum_swing_up:EnergyShaping",
    },
)
"""Controllers by the name of the task that they are for."""


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
    possible = []
    for name in BASELINES:
        with suppress(ValueError):
            make_baseline(name, setup, controller=controller)
            possible.append(name)
    return tuple(possible)


def has_handmade(setup: Setup) -> bool:
    """Whether there is a hand-made controller for the environment's task."""
    return any(isinstance(setup.task, TASKS.load(name)) for name in HANDMADE.parts)


def _handmade(setup: Any, controller: str | None) -> Policy:
    """The hand-made controller of that name, or of the environment's task."""
    if setup.arguments().get("gravity") == 0.0:
        raise ValueError("without gravity there is nothing to balance; leave `handmade` out")
    tasks = {name: TASKS.load(name) for name in HANDMADE.parts}
    fitting = (name for name, task in tasks.items() if isinstance(setup.task, task))
    chosen = controller or next(fitting, None)
    if chosen is None:
        raise ValueError(
            f"there is no hand-made controller for the task {type(setup.task).__name__}, only for "
            f"{', '.join(task.__name__ for task in tasks.values())}; leave `handmade` out"
        )
    made: Policy = HANDMADE.load(chosen)(setup)
    return made
