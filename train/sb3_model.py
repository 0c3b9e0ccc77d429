"""stable-baselines3's (SB3) PPO models: made from a configuration, or from trained weights."""

from __future__ import annotations

import io
import random
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

if TYPE_CHECKING:
    from integ_gym.train.ppo.config import PPOConfig


def model_arguments(config: PPOConfig, control_period: float) -> dict[str, Any]:
    """Keyword arguments of SB3's `PPO`, for a control period in s."""
    import torch
    from stable_baselines3.common.utils import LinearSchedule

    rate, rate_end = config.learning_rate, config.learning_rate_end
    return {
        "learning_rate": rate if rate_end is None else LinearSchedule(rate, rate_end, 1.0),
        "n_steps": config.n_steps,
        "batch_size": config.batch_size,
        "n_epochs": config.n_epochs,
        "gamma": config.discount(control_period),
        "gae_lambda": config.gae_lambda,
        "clip_range": config.clip_range,
        "normalize_advantage": config.normalize_advantage,
        "ent_coef": config.ent_coef,
        "vf_coef": config.vf_coef,
        "max_grad_norm": config.max_grad_norm,
        "target_kl": config.target_kl,
        "policy_kwargs": {
            "net_arch": {"pi": list(config.net_arch), "vf": list(config.net_arch)},
            "activation_fn": getattr(torch.nn, config.activation),
            "log_std_init": config.log_std_init,
        },
        "seed": config.seed,
        "device": "cpu",
    }


def zip_of_weights(
    config: PPOConfig,
    control_period: float,
    observation_space: spaces.Box,
    action_space: spaces.Space[Any],
    weights: Mapping[str, NDArray[np.float32]],
    steps: int,
) -> bytes:
    """What SB3 would have saved had it trained these weights; its optimizer starts anew.

    Args:
        config: the training run.
        control_period: of its environment, s.
        observation_space: of a single environment.
        action_space: of a single environment.
        weights: by SB3's names.
        steps: decisions taken.
    """
    import torch
    from stable_baselines3 import PPO

    arguments: Any = model_arguments(config, control_period)
    with reproducible():
        model = PPO("MlpPolicy", None, **arguments, _init_setup_model=False)  # type: ignore[arg-type]
        model.observation_space, model.action_space = observation_space, action_space
        model.n_envs = config.n_envs
        model._setup_model()
        model.policy.load_state_dict({k: torch.from_numpy(v) for k, v in weights.items()})
        model.num_timesteps = model._total_timesteps = steps
        return saved(model)


def saved(model: Any) -> bytes:
    """The bytes of a model's zip."""
    buffer = io.BytesIO()
    model.save(buffer, exclude=["tensorboard_log"])
    return buffer.getvalue()


@contextmanager
def reproducible() -> Iterator[None]:
    """One torch thread; afterwards the thread count and all global random states are put back."""
    import torch

    threads, states = torch.get_num_threads(), torch.get_rng_state()
    python, legacy = random.getstate(), np.random.get_state()  # noqa: NPY002  (SB3 seeds it)
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)
        torch.set_rng_state(states)
        random.setstate(python)
        np.random.set_state(legacy)  # noqa: NPY002
