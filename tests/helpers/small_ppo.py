"""A short run of PPO, and what looks on."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gymnasium.vector import VectorWrapper

from integ_gym.train import ppo
from integ_gym.train.policy_files.sidecar import TrainedPolicy
from integ_gym.train.ppo import PPOConfig
from integ_gym.train.runs import train_ppo

SMALL = PPOConfig(
    env_arguments={"integrator": "rk4", "max_torque": 0.8, "duration": 2.5, "start": "hanging"},
    seed=3,
    total_steps=500,
    n_envs=4,
    n_steps=64,
    batch_size=64,
    n_epochs=2,
    net_arch=(16, 8),
)

FLAGS = [
    *("--integrator", "rk4", "--max-torque", "0.8", "--duration", "2.5", "--start", "hanging"),
    *("--seed", "3", "--total-steps", "500", "--n-envs", "4", "--n-steps", "64"),
    *("--batch-size", "64", "--n-epochs", "2", "--net-arch", "16", "8"),
]
WRITTEN = {"policy.zip", "policy.json", "policy.safetensors"}


def trained(config: PPOConfig, folder: Path, **options: Any) -> TrainedPolicy:
    """One policy, trained without a word."""
    (policy,) = train_ppo([config], [folder], **{"progress": False, "tensorboard": False} | options)
    return policy


def looked_on(monkeypatch: pytest.MonkeyPatch, wrap: Callable[[Any], Any]) -> list[Any]:
    """Training environments are wrapped from now on; the list holds what wraps them."""
    made: list[Any] = []
    make = ppo.make_training_envs

    def wrapped(config: PPOConfig) -> Any:
        made.append(wrap(make(config)))
        return made[-1]

    monkeypatch.setattr(ppo, "make_training_envs", wrapped)
    return made


class Recorder(VectorWrapper[Any, Any, Any, Any, Any]):
    """Adds up what a recorder would see."""

    def __init__(self, env: Any, fail_at: int | None = None) -> None:
        super().__init__(env)
        self.fail_at = fail_at
        self.rewards: list[np.ndarray] = []
        self.starts: list[np.ndarray] = []
        self.closed_by_trainer = False

    def reset(self, **kwargs: Any) -> Any:
        result = super().reset(**kwargs)
        self.starts.append(self.env.unwrapped.state)  # type: ignore[attr-defined]
        return result

    def step(self, actions: Any) -> Any:
        if len(self.rewards) == self.fail_at:
            raise KeyboardInterrupt
        result = super().step(actions)
        self.rewards.append(result[1])
        return result

    def close(self, **kwargs: Any) -> None:
        self.closed_by_trainer = True
        super().close(**kwargs)


def files_of(folder: Path) -> set[str]:
    return {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}
