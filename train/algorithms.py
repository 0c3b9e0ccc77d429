"""What learns with stable-baselines3, by name."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

from .config import TrainingConfig
from .ppo import PPOConfig, train_ppo
from .sac import SACConfig, train_sac


@dataclass(frozen=True)
class Algorithm:
    """Its hyperparameters, and what trains with them."""

    config: type[TrainingConfig]
    train: Any


ALGORITHMS: Final[Mapping[str, Algorithm]] = {
    "ppo": Algorithm(PPOConfig, train_ppo),
    "sac": Algorithm(SACConfig, train_sac),
}
"""The first is what trains where nothing else is said; the fleet trains it alone."""
