"""What every training run is told, whichever algorithm learns."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, Self

import gymnasium as gym
import numpy as np

from integ_gym.envs.catalogue.lookup import OTHER_TESTBEDS
from integ_gym.envs.registries import ENVIRONMENTS
from integ_gym.support.parameters import (
    check_values,
    parameter,
    positive,
    text,
    unknown_name,
)

from .checks import ENV_ARGUMENTS, LONGEST, MOST_LANES, check_names, layer_sizes, whole

_GIVEN_BY_THE_TRAINER = ("num_envs", "vectorization_mode", "autoreset_mode", "render_mode")


@dataclass(frozen=True)
class TrainingConfig:
    """Hyperparameters of every algorithm; each adds its own.

    Raises:
        ValueError: for an impossible value, in one sentence.
    """

    algorithm: ClassVar[str]
    """As it is called: PPO, SAC."""
    environment_defaults: ClassVar[Mapping[str, Mapping[str, Any]]] = {}
    """Where an environment's defaults differ from those of the class."""
    continuous_actions: ClassVar[bool] = False
    """Whether it needs a `Box` of actions."""

    env_id: str = parameter("IntegPendulum-v0", "", "environment", text)
    env_arguments: dict[str, Any] = field(default_factory=dict, metadata=ENV_ARGUMENTS)
    seed: int = parameter(0, "", "of starts, noise, weights and exploration", whole(0, 2**32 - 1))
    total_steps: int = parameter(
        300_000, "", "decisions of all environments together, rounded up", whole(1, LONGEST)
    )
    n_envs: int = parameter(16, "", "environments that advance together", whole(1, MOST_LANES))
    learning_rate: float = parameter(1e-3, "", "Adam's, at the start", positive)
    discount_time: float = parameter(
        1.0, "s", "τ of the discount per decision, γ = exp(-control_period / τ)", positive
    )
    reward_scale: float = parameter(
        0.1, "", "factor on rewards for the learner; all that is reported is unscaled", positive
    )
    net_arch: tuple[int, ...] = parameter(
        (64, 64), "", "sizes of hidden layers, of actor and critic each", layer_sizes
    )
    trace_every: int = parameter(50, "", "every N-th training episode has a trace", whole(1))

    def __post_init__(self) -> None:
        if isinstance(self.net_arch, list):
            object.__setattr__(self, "net_arch", tuple(self.net_arch))
        check_values(type(self), vars(self))
        known = (*ENVIRONMENTS, *gym.registry)
        if not (self.env_id in known or ":" in self.env_id):
            unknown = unknown_name("environment", self.env_id, ENVIRONMENTS)
            raise ValueError(f"{unknown}, {OTHER_TESTBEDS}")
        for name in _GIVEN_BY_THE_TRAINER:
            if name in self.env_arguments:
                raise ValueError(f"`{name}` is not an environment argument; leave it out")

    @classmethod
    def of(cls, env_id: str, **overrides: Any) -> Self:
        """The defaults that are known to learn an environment, with some values replaced.

        Raises:
            TypeError, ValueError: for unknown or impossible values.
        """
        check_names(cls, overrides)
        return cls(**{"env_id": env_id, **cls.environment_defaults.get(env_id, {}), **overrides})

    @classmethod
    def check_actions(cls, actions: gym.Space[Any]) -> None:
        """Check that the algorithm can learn an environment's actions.

        Raises:
            ValueError: for an action space that it cannot, with one that can.
        """
        if cls.continuous_actions and not isinstance(actions, gym.spaces.Box):
            raise ValueError(f"{cls.algorithm} needs continuous actions, got {actions}; take PPO")

    @property
    def rollout(self) -> int:
        """Decisions between two updates, over all environments."""
        raise NotImplementedError

    @property
    def rounded_steps(self) -> int:
        """Decisions that the run will take: whole rollouts."""
        return math.ceil(self.total_steps / self.rollout) * self.rollout

    @property
    def first_lane_seed(self) -> int:
        """Seed of the first training environment; the others count up from it.

        Spread out, so that runs with neighbouring seeds do not share start states.
        """
        return int(np.random.SeedSequence(self.seed).generate_state(1)[0])

    def discount(self, control_period: float) -> float:
        """γ, the discount per decision, for a control period in s."""
        return math.exp(-control_period / self.discount_time)

    def derived(self, control_period: float) -> dict[str, Any]:
        """What follows from the hyperparameters, for a control period in s."""
        return {
            "gamma": self.discount(control_period),
            "rollout": self.rollout,
            "first_lane_seed": self.first_lane_seed,
        }
