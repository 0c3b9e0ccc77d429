"""One training run with stable-baselines3 (SB3): `train`.

It writes `policy.zip` (an SB3 model), `policy.json` (how it came about) and `tensorboard/`. The
same configuration gives the same weights bit by bit on one machine: one thread, fixed seeds, no
GPU.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, TypeAlias

import gymnasium as gym
from gymnasium.vector import AutoresetMode, VectorEnv

from integ_gym.envs.extras import load
from integ_gym.envs.integrators import INTEGRATORS
from integ_gym.envs.mixture import Mixture
from integ_gym.envs.registration import register_environments
from integ_gym.envs.settings import Setup
from integ_gym.train.card import make_card
from integ_gym.train.ppo.config import PPOConfig
from integ_gym.train.ppo.errors import TrainingError
from integ_gym.train.ppo.progress import Progress, last_episodes
from integ_gym.train.sb3_model import model_arguments, reproducible, saved
from integ_gym.train.seeds import first_lane_seed
from integ_gym.train.sidecar import TrainedPolicy, claim_folder, write_policy

Wrap: TypeAlias = Callable[[VectorEnv[Any, Any, Any]], VectorEnv[Any, Any, Any]]
"""Wraps the training environments, for example to record their episodes; keeps their API."""


def train(
    config: PPOConfig,
    out_dir: str | Path,
    *,
    wrap: Wrap | None = None,
    progress: bool = True,
    on_steps: Callable[[int], None] | None = None,
    tensorboard: bool = True,
    force: bool = False,
) -> TrainedPolicy:
    """Train one policy and write it.

    Nothing outside the run changes: torch's thread count and the global random states are put back.

    Args:
        config: the run.
        out_dir: folder for `policy.zip`, `policy.json` and `tensorboard/`.
        wrap: put around the training environments, whose rewards it sees unscaled.
        progress: show a bar on stderr.
        on_steps: told the number of decisions after each advance.
        tensorboard: write logs.
        force: replace a policy that is already there.

    Raises:
        OSError: if the folder cannot be used, or holds a policy and `force` is not given.
        TypeError, ValueError: for environment arguments that are not possible.
        ModuleNotFoundError: if the extra is missing, with the command that installs it.
    """
    need_extra(tensorboard)
    folder = claim_folder(out_dir, force)
    vector_env = make_training_envs(config)
    mixture: Mixture = vector_env.unwrapped.mixture  # type: ignore[attr-defined]
    if wrap is not None:
        vector_env = wrap(vector_env)
    try:
        with reproducible():
            model = _make_model(config, vector_env, mixture.setups[0])
            _log_to(model, folder / "tensorboard" if tensorboard else None)
            start = time.perf_counter()
            with Progress(config.rounded_steps, progress, on_steps) as bar:
                _learn(model, config, bar, _own_integrators(mixture))
            seconds = time.perf_counter() - start
            model.logger.close()
            zip_bytes = saved(model)
    finally:
        vector_env.close()
    card = make_card(
        config,
        mixture,
        trainer="sb3",
        packages=("stable-baselines3", "torch"),
        steps=int(model.num_timesteps),
        seconds=seconds,
        last_episodes=last_episodes(model),
    )
    return write_policy(folder, zip_bytes, card, vector_env.single_action_space)


def _learn(model: Any, config: PPOConfig, callback: Any, integrators: Iterable[str]) -> None:
    """Train.

    Raises:
        TrainingError: if the weights are no longer finite, or one of ``integrators`` fails.
    """
    try:
        model.learn(config.total_steps, callback=callback)
    except Exception as error:
        failed = INTEGRATORS.at_work(error, integrators)
        if failed:
            raise TrainingError(
                f"the integrator {failed[0]!r} failed: {type(error).__name__}: {error}; "
                "docs/adding.md says what an integrator must be"
            ) from error
        if not isinstance(error, ValueError):
            raise
        raise TrainingError(
            "training broke down: the policy's weights are no longer finite; lower "
            f"`learning_rate`={config.learning_rate:g}"
        ) from error


def _own_integrators(mixture: Mixture) -> tuple[str, ...]:
    """References to integrators of the user's own."""
    names = (setup.settings.integrator for setup in mixture.setups)
    return tuple(dict.fromkeys(name for name in names if ":" in name))


def make_training_envs(config: PPOConfig) -> VectorEnv[Any, Any, Any]:
    """The training environments, which reset within the step that ends an episode.

    Raises:
        TypeError, ValueError: for arguments that are not possible.
    """
    register_environments()
    return gym.make_vec(
        config.env_id,
        num_envs=config.n_envs,
        vectorization_mode="vector_entry_point",
        autoreset_mode=AutoresetMode.SAME_STEP.value,
        **config.env_arguments,
    )


def _make_model(config: PPOConfig, vector_env: VectorEnv[Any, Any, Any], setup: Setup) -> Any:
    """SB3's PPO, with episodes monitored before rewards are scaled."""
    from stable_baselines3 import PPO
    from stable_baselines3.common.vec_env import VecMonitor

    from integ_gym.train.vec_env import Sb3VecEnv, ScaledRewards

    episodes = VecMonitor(Sb3VecEnv(vector_env, info_keys=("success",)))
    scaled = ScaledRewards(episodes, config.reward_scale)
    model = PPO("MlpPolicy", scaled, **model_arguments(config, setup.timing.control_period))
    episodes.seed(first_lane_seed(config.seed))
    return model


def _log_to(model: Any, folder: Path | None) -> None:
    """Log to TensorBoard, or not at all."""
    from stable_baselines3.common.logger import Logger, TensorBoardOutputFormat

    outputs: list[Any] = [] if folder is None else [TensorBoardOutputFormat(str(folder))]
    model.set_logger(Logger(None if folder is None else str(folder), outputs))


def need_extra(tensorboard: bool) -> None:
    """Import what the extra brings.

    Raises:
        ModuleNotFoundError: with the command that installs it.
    """
    for name in ("torch", "stable_baselines3", "tqdm", *(["tensorboard"] if tensorboard else [])):
        load(name, "train")
