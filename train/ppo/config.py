"""Every hyperparameter of a training run, checked, and what differs between environments."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from typing import Any

from integ_gym.envs.parameters import (
    boolean,
    check_values,
    finite,
    nonnegative,
    one_of,
    optional,
    parameter,
    positive,
    text,
    unknown_name,
)
from integ_gym.envs.registration import ENVIRONMENTS
from integ_gym.train.policy.activations import ACTIVATIONS

_GIVEN_BY_THE_TRAINER = ("num_envs", "vectorization_mode", "autoreset_mode", "render_mode")


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


def layer_sizes(value: Any) -> str | None:
    """Sizes of layers."""
    fits = isinstance(value, tuple) and all(whole(1)(size) is None for size in value)
    return None if fits else "must be a list of whole numbers, 1 or above"


def named_values(value: Any) -> str | None:
    """A mapping from names."""
    fits = isinstance(value, Mapping) and all(isinstance(name, str) for name in value)
    return None if fits else "must map argument names to values"


@dataclass(frozen=True)
class PPOConfig:
    """Everything that decides a training run. `PPOConfig.of` has defaults for each environment.

    Raises:
        ValueError: for an impossible value, in one sentence.
    """

    env_id: str = parameter("IntegPendulum-v0", "", "environment", text)
    env_arguments: dict[str, Any] = field(
        default_factory=dict,
        metadata={
            "unit": "",
            "meaning": "constructor arguments, `mixture` among them; those left out take the "
            "environment's defaults",
            "check": named_values,
        },
    )
    seed: int = parameter(
        0, "", "of starts, sensor noise, weights and exploration", whole(0, 2**32 - 1)
    )
    total_steps: int = parameter(
        300_000, "", "decisions of all environments together, rounded up to rollouts", whole(1)
    )
    n_envs: int = parameter(16, "", "environments that advance together", whole(1))
    n_steps: int = parameter(256, "", "decisions per environment in a rollout", whole(1))
    batch_size: int = parameter(256, "", "decisions per gradient step", whole(2))
    n_epochs: int = parameter(10, "", "passes over each rollout", whole(1))
    learning_rate: float = parameter(1e-3, "", "Adam's, at the start", positive)
    learning_rate_end: float | None = parameter(
        None, "", "reached linearly at the end; None: constant", optional(nonnegative)
    )
    discount_time: float = parameter(
        1.0, "s", "τ of the discount per decision, γ = exp(-control_period / τ)", positive
    )
    gae_lambda: float = parameter(
        0.95, "", "λ of generalized advantage estimation, per decision", fraction
    )
    clip_range: float = parameter(0.2, "", "of the probability ratio, around 1", positive)
    ent_coef: float = parameter(0.0, "", "weight of the entropy bonus", nonnegative)
    vf_coef: float = parameter(0.5, "", "weight of the value loss", nonnegative)
    max_grad_norm: float = parameter(0.5, "", "larger gradients are scaled to it", positive)
    normalize_advantage: bool = parameter(True, "", "in each gradient step", boolean)
    target_kl: float | None = parameter(
        None, "", "stop a rollout's passes beyond 1.5 times this; None: never", optional(positive)
    )
    reward_scale: float = parameter(
        0.1, "", "factor on rewards for the learner; all that is reported is unscaled", positive
    )
    net_arch: tuple[int, ...] = parameter(
        (64, 64), "", "sizes of hidden layers, of actor and critic each", layer_sizes
    )
    activation: str = parameter("Tanh", "", "class of torch.nn", one_of(*ACTIVATIONS))
    log_std_init: float = parameter(
        0.0, "", "log of the exploration noise at the start (Box actions)", finite
    )
    trace_every: int = parameter(
        50, "", "every N-th training episode is recorded with its trace", whole(1)
    )

    def __post_init__(self) -> None:
        """Check every value, and that rollouts split into batches."""
        if isinstance(self.net_arch, list):
            object.__setattr__(self, "net_arch", tuple(self.net_arch))
        check_values(PPOConfig, {f.name: getattr(self, f.name) for f in fields(self)})
        if self.env_id not in ENVIRONMENTS:
            raise ValueError(unknown_name("environment", self.env_id, ENVIRONMENTS))
        for name in _GIVEN_BY_THE_TRAINER:
            if name in self.env_arguments:
                raise ValueError(f"`{name}` is not an environment argument; leave it out")
        if self.rollout % self.batch_size:
            raise ValueError(
                f"`batch_size`={self.batch_size} does not divide a rollout of `n_envs` × `n_steps` "
                f"= {self.rollout} decisions; give a divisor, such as "
                f"{_nearest_divisor(self.rollout, self.batch_size)}"
            )

    @classmethod
    def of(cls, env_id: str, **overrides: Any) -> PPOConfig:
        """The defaults that are known to learn an environment, with some values replaced.

        Raises:
            TypeError, ValueError: for unknown or impossible values.
        """
        names = [f.name for f in fields(cls)]
        for name in overrides:
            if name not in names:
                raise TypeError(unknown_name("hyperparameter", name, names))
        return cls(**{"env_id": env_id, **ENVIRONMENT_DEFAULTS.get(env_id, {}), **overrides})

    @property
    def rollout(self) -> int:
        """Decisions between two updates, over all environments."""
        return self.n_envs * self.n_steps

    @property
    def rounded_steps(self) -> int:
        """Decisions that the run will take: whole rollouts."""
        return math.ceil(self.total_steps / self.rollout) * self.rollout

    def discount(self, control_period: float) -> float:
        """γ, the discount per decision, for a control period in s."""
        return math.exp(-control_period / self.discount_time)


ENVIRONMENT_DEFAULTS: dict[str, dict[str, Any]] = {
    "IntegPendulum-v0": {},
    "IntegCartPole-v0": {"total_steps": 100_000, "n_steps": 64},
}
"""Where an environment's defaults differ from those of `PPOConfig`.

Balancing learns from short rollouts, because episodes end early at first: 5 of 5 seeds hold every
start for 10 s after 33 000 decisions, and after 50 000 to 98 000 with rollouts of 256.
"""


def _nearest_divisor(whole: int, wanted: int) -> int:
    """The divisor of ``whole`` whose ratio to ``wanted`` is nearest to 1."""
    divisors = [n for n in range(1, whole + 1) if whole % n == 0]
    return min(divisors, key=lambda n: abs(math.log(n / wanted)))
