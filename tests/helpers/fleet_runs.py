"""Runs that the fleet trains within seconds, and what is done in its processes."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from integ_gym.evidence.labels import EpisodeContext
from integ_gym.support.processes import peak_memory
from integ_gym.train.config import TrainingEvidence
from integ_gym.train.fleet.training import train_chunk
from integ_gym.train.ppo import PPOConfig

OF_EACH_ACTION = ["IntegCartPole-v0", "IntegPendulum-v0"]
"""An environment with discrete actions and one with continuous."""

SMALL = {"n_envs": 4, "n_steps": 32, "batch_size": 64, "n_epochs": 2, "net_arch": (16, 8)}


def small_run(env_id: str = "IntegPendulum-v0", **overrides: Any) -> PPOConfig:
    """A short run of a small network."""
    return PPOConfig.of(env_id, **{**SMALL, "total_steps": 256, **overrides})


def trained_memory(configs: Sequence[PPOConfig], folder: Path) -> int:
    """Most that this process has held after training runs together, with evidence, bytes."""
    told = []
    for config in configs:
        name, every = f"seed{config.seed}", config.trace_every
        context = EpisodeContext("cell", name, phase="training", trace_every=every)
        told.append(TrainingEvidence(folder, name, context))
    train_chunk(configs, told)
    return peak_memory() or 0


def own_gpu() -> str:
    """What this process may use."""
    return os.environ["CUDA_VISIBLE_DEVICES"]
