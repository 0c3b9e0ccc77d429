"""Proximal policy optimization (PPO): its configuration, the reference trainer, the command.

The reference trainer is stable-baselines3's (SB3); `integ_gym.train.fleet` trains many policies at
once from the same `PPOConfig`.

Source: Schulman et al. (2017), *Proximal policy optimization algorithms*, arXiv:1707.06347.
"""

from integ_gym.train.ppo.command import main
from integ_gym.train.ppo.config import ENVIRONMENT_DEFAULTS, PPOConfig
from integ_gym.train.ppo.errors import TrainingError
from integ_gym.train.ppo.training import Wrap, make_training_envs, train

__all__ = [
    "ENVIRONMENT_DEFAULTS",
    "PPOConfig",
    "TrainingError",
    "Wrap",
    "main",
    "make_training_envs",
    "train",
]
