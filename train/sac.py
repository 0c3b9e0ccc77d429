"""Soft actor-critic (SAC) with stable-baselines3 (SB3), for continuous actions.

    python train/sac.py --env InvertedPendulum-v5 --integrator rk4 --dt 0.02

Hyperparameters and model; environments, learning and files are those of `train/ppo.py`. It needs
fewer decisions than PPO and more computing for each.

Source: Haarnoja et al. (2018), *Soft actor-critic: off-policy maximum entropy deep reinforcement
learning with a stochastic actor*, arXiv:1801.01290; entropy coefficient: arXiv:1812.05905.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, field
from typing import Any, ClassVar

from integ_gym.support.parameters import one_of, parameter, positive, text
from integ_gym.train.config import (
    ENV_ARGUMENTS,
    LONGEST,
    MOST_LANES,
    TrainingConfig,
    fraction,
    layer_sizes,
    whole,
)
from integ_gym.train.policy import ACTIVATIONS


@dataclass(frozen=True)
class SACConfig(TrainingConfig):
    """Everything that decides a training run by SAC.

    Raises:
        ValueError: for an impossible value, in one sentence.
    """

    algorithm: ClassVar[str] = "SAC"
    continuous_actions: ClassVar[bool] = True

    env_id: str = parameter("IntegPendulum-v0", "", "environment", text)
    env_arguments: dict[str, Any] = field(default_factory=dict, metadata=ENV_ARGUMENTS)
    seed: int = parameter(0, "", "of starts, noise, weights and exploration", whole(0, 2**32 - 1))
    total_steps: int = parameter(
        20_000, "", "decisions of all environments together, rounded up", whole(1, LONGEST)
    )
    n_envs: int = parameter(4, "", "environments that advance together", whole(1, MOST_LANES))
    learning_rate: float = parameter(1e-3, "", "Adam's, at the start", positive)
    discount_time: float = parameter(
        1.0, "s", "τ of the discount per decision, γ = exp(-control_period / τ)", positive
    )
    reward_scale: float = parameter(
        1.0, "", "factor on rewards for the learner; all that is reported is unscaled", positive
    )
    net_arch: tuple[int, ...] = parameter(
        (64, 64), "", "sizes of hidden layers, of actor and critic each", layer_sizes
    )
    trace_every: int = parameter(50, "", "every N-th training episode has a trace", whole(1))
    batch_size: int = parameter(256, "", "decisions per gradient step", whole(2))
    buffer_size: int = parameter(
        1_000_000, "", "latest decisions that are learned from", whole(1, 1 << 24)
    )
    learning_starts: int = parameter(
        1000, "", "decisions drawn at random before learning", whole(0, LONGEST)
    )
    train_freq: int = parameter(1, "", "decisions per environment between updates", whole(1))
    gradient_steps: int = parameter(
        -1, "", "gradient steps of an update; -1: one for each decision since the last", whole(-1)
    )
    tau: float = parameter(0.005, "", "share of the critics in their targets' updates", fraction)
    initial_entropy: float = parameter(
        0.1, "", "entropy coefficient at the start; it is learned", positive
    )
    activation: str = parameter("ReLU", "", "class of torch.nn", one_of(*ACTIVATIONS))

    @property
    def rollout(self) -> int:
        """Decisions between two updates, over all environments."""
        return self.n_envs * self.train_freq


def model_arguments(config: SACConfig, control_period: float) -> dict[str, Any]:
    """Keyword arguments of SB3's `SAC`, for a control period in s."""
    import torch

    alike = (
        *("learning_rate", "buffer_size", "learning_starts", "batch_size", "tau", "train_freq"),
        *("gradient_steps", "seed"),
    )
    return {
        **{name: getattr(config, name) for name in alike},
        "gamma": config.discount(control_period),
        "ent_coef": f"auto_{config.initial_entropy}",
        "policy_kwargs": {
            "net_arch": list(config.net_arch),
            "activation_fn": getattr(torch.nn, config.activation),
        },
        "device": "cpu",
    }


def make_model(config: SACConfig, environments: Any, control_period: float) -> Any:
    """SB3's `SAC`, which has not learned yet."""
    from stable_baselines3 import SAC

    return SAC("MlpPolicy", environments, **model_arguments(config, control_period))


if __name__ == "__main__":
    from integ_gym.train.command import training_command

    sys.exit(training_command(prog="python train/sac.py", algorithm="sac"))
