"""What training with stable-baselines3 (SB3) needs beside its model."""

from __future__ import annotations

import io
import random
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from threading import Thread
from typing import Any, TypeAlias

import numpy as np
from gymnasium.spaces import Space
from numpy.typing import NDArray

from integ_gym.support.optional import absent

from ..policy_files.card import episode_summary, told


def can_save() -> bool:
    """Whether what :func:`zip_of_weights` needs is installed."""
    return not absent(("stable_baselines3", "torch"))


@cache
def import_ahead() -> Thread:
    """Import what :func:`zip_of_weights` takes seconds to, once, beside other work."""
    thread = Thread(target=_import)
    thread.start()
    return thread


def _import() -> None:
    import stable_baselines3  # noqa: F401
    import torch

    torch.optim.Adam([torch.zeros(1)])  # the first optimizer imports half of torch


def zip_of_weights(
    arguments: Mapping[str, Any],
    n_envs: int,
    spaces: tuple[Space[Any], Space[Any]],
    weights: Mapping[str, NDArray[np.float32]],
    steps: int,
) -> bytes:
    """What SB3 would have saved had it trained these weights; its optimizer starts anew.

    Args:
        arguments: of SB3's `PPO`.
        n_envs: environments that advanced together.
        spaces: of observations and actions of a single environment.
        weights: by SB3's names.
        steps: decisions taken.
    """
    import torch
    from stable_baselines3 import PPO

    with reproducible():
        model: Any = PPO("MlpPolicy", None, **arguments, _init_setup_model=False)  # type: ignore[arg-type]
        model.observation_space, model.action_space = spaces
        model.n_envs = n_envs
        model._setup_model()
        model.policy.load_state_dict({k: torch.from_numpy(v) for k, v in weights.items()})
        model.num_timesteps = model._total_timesteps = steps
        return saved(model)


def saved(model: Any) -> bytes:
    """The bytes of a model's zip."""
    buffer = io.BytesIO()
    model.save(buffer, exclude=["tensorboard_log"])
    return buffer.getvalue()


Tell: TypeAlias = Callable[[int, str], object]
"""Told, as training goes on, how many decisions were taken and how the last episodes went."""


def telling(tell: Tell) -> Callable[[dict[str, Any], dict[str, Any]], bool]:
    """A callback for SB3, which calls it after every step of the environments."""
    done, words, ended = 0, "", False

    def callback(variables: dict[str, Any], _: dict[str, Any]) -> bool:
        nonlocal done, words, ended
        model = variables["self"]
        if ended:  # SB3 counts the episodes of a step after this call
            words = told(last_episodes(model))
        tell(model.num_timesteps - done, words)
        done, ended = model.num_timesteps, variables["dones"].any()
        return True

    return callback


def last_episodes(model: Any) -> dict[str, Any]:
    """The last (up to 100) episodes of training."""
    returns = [float(episode["r"]) for episode in model.ep_info_buffer]
    return episode_summary(returns, [float(success) for success in model.ep_success_buffer])


def logger(folder: Path | None) -> Any:
    """SB3's logger to TensorBoard, or one that is silent."""
    from stable_baselines3.common.logger import Logger, TensorBoardOutputFormat

    if folder is None:
        return Logger(None, [])
    return Logger(str(folder), [TensorBoardOutputFormat(str(folder))])


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
