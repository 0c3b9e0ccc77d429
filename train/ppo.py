"""Proximal policy optimization (PPO) with stable-baselines3 (SB3), as one script.

    python train/ppo.py --integrator rk4 --dt 0.05

Hyperparameters, environments, model, learning, files: all that decides a result, from top to
bottom. Of integ-gym it imports how hyperparameters are declared, how environments are made, how a
policy is written and how evidence is recorded. The same configuration gives the same weights bit by
bit on one machine: one thread, fixed seeds, no GPU. `integ_gym.train.fleet.training` trains many
policies at once from the same `PPOConfig`.

Source: Schulman et al. (2017), *Proximal policy optimization algorithms*, arXiv:1707.06347.
"""

from __future__ import annotations

import io
import random
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from gymnasium.vector import VectorEnv

from integ_gym.envs.testbeds.making import make_training_environments
from integ_gym.support.parameters import (
    boolean,
    finite_number,
    nonnegative,
    one_of,
    optional,
    parameter,
    positive,
    text,
)
from integ_gym.train.config import (
    ENV_ARGUMENTS,
    LONGEST,
    MOST_LANES,
    TrainingConfig,
    TrainingEvidence,
    check_rollout,
    fraction,
    layer_sizes,
    translate_training_errors,
    whole,
)
from integ_gym.train.policy import ACTIVATIONS
from integ_gym.train.policy_files.card import (
    episode_summary,
    format_episode_stats,
    make_card,
    mixture_of,
)
from integ_gym.train.policy_files.sidecar import TrainedPolicy, write_policy

# ---------------------------------------------------------------------------------- hyperparameters


@dataclass(frozen=True)
class PPOConfig(TrainingConfig):
    """Everything that decides a training run. `PPOConfig.of` has defaults for each environment.

    Raises:
        ValueError: for an impossible value, in one sentence.
    """

    algorithm: ClassVar[str] = "PPO"
    environment_defaults: ClassVar[Mapping[str, Mapping[str, Any]]] = {
        "IntegCartPole-v0": {"total_steps": 100_000, "n_steps": 64},
    }
    """Balancing learns from short rollouts, because episodes end early at first: 5 of 5 seeds hold
    every start for 10 s after 33 000 decisions, and after 50 000 to 98 000 with rollouts of 256."""

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
    n_steps: int = parameter(256, "", "decisions per environment in a rollout", whole(1))
    batch_size: int = parameter(256, "", "decisions per gradient step", whole(2))
    n_epochs: int = parameter(10, "", "passes over each rollout", whole(1))
    learning_rate_end: float | None = parameter(
        None, "", "reached linearly at the end; None: constant", optional(nonnegative)
    )
    gae_lambda: float = parameter(0.95, "", "λ of generalized advantage estimation", fraction)
    clip_range: float = parameter(0.2, "", "of the probability ratio, around 1", positive)
    ent_coef: float = parameter(0.0, "", "weight of the entropy bonus", nonnegative)
    vf_coef: float = parameter(0.5, "", "weight of the value loss", nonnegative)
    max_grad_norm: float = parameter(0.5, "", "larger gradients are scaled to it", positive)
    normalize_advantage: bool = parameter(True, "", "in each gradient step", boolean)
    target_kl: float | None = parameter(
        None, "", "stop a rollout's passes beyond 1.5 times this; None: never", optional(positive)
    )
    activation: str = parameter("Tanh", "", "class of torch.nn", one_of(*ACTIVATIONS))
    log_std_init: float = parameter(
        0.0, "", "log of the first exploration noise, in the action's unit (Box)", finite_number
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        check_rollout(self.n_envs, self.n_steps, self.batch_size)

    @property
    def rollout(self) -> int:
        """Decisions between two updates, over all environments."""
        return self.n_envs * self.n_steps

    def derived(self, control_period: float) -> dict[str, Any]:
        """What follows from the hyperparameters, for a control period in s."""
        return {**super().derived(control_period), "gae_lambda": self.gae_lambda}


# ------------------------------------------------------------------------------------- environments


def make_training_envs(config: TrainingConfig) -> VectorEnv[Any, Any, Any]:
    """The training environments, which reset within the step that ends an episode.

    Raises:
        TypeError, ValueError: for arguments that are not possible.
    """
    return make_training_environments(config.env_id, config.env_arguments, config.n_envs)


# -------------------------------------------------------------------------------------------- model


def model_arguments(config: PPOConfig, control_period: float) -> dict[str, Any]:
    """Keyword arguments of SB3's `PPO`, for a control period in s."""
    import torch
    from stable_baselines3.common.utils import LinearSchedule

    alike = (
        *("n_steps", "batch_size", "n_epochs", "gae_lambda", "clip_range", "normalize_advantage"),
        *("ent_coef", "vf_coef", "max_grad_norm", "target_kl", "seed"),
    )
    rate, rate_end = config.learning_rate, config.learning_rate_end
    return {
        **{name: getattr(config, name) for name in alike},
        "learning_rate": rate if rate_end is None else LinearSchedule(rate, rate_end, 1.0),
        "gamma": config.discount(control_period),
        "policy_kwargs": {
            "net_arch": {"pi": list(config.net_arch), "vf": list(config.net_arch)},
            "activation_fn": getattr(torch.nn, config.activation),
            "log_std_init": config.log_std_init,
        },
        "device": "cpu",
    }


def make_model(config: PPOConfig, environments: Any, control_period: float) -> Any:
    """SB3's `PPO`, which has not learned yet."""
    from stable_baselines3 import PPO

    return PPO("MlpPolicy", environments, **model_arguments(config, control_period))


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


# ------------------------------------------------------------------------------- learning and files


def train_run(
    config: TrainingConfig,
    folder: Path,
    evidence: TrainingEvidence | None = None,
    *,
    make_model: Callable[[Any, Any, float], Any] = make_model,
    report: Callable[[int, str], object] = lambda steps, words: None,
    tensorboard: bool = False,
) -> TrainedPolicy:
    """Train one policy in this process.

    Nothing outside the run changes: torch's thread count and the global random states are put back.

    Args:
        config: the run.
        folder: for the policy.
        evidence: where the training episodes are recorded; None: nowhere.
        make_model: what learns; `train/sac.py` gives its own.
        report: called with the decisions since the last call, and how the last episodes went.
        tensorboard: write logs beside the policy.
    """
    from stable_baselines3.common.logger import Logger, TensorBoardOutputFormat
    from stable_baselines3.common.vec_env import VecMonitor

    from integ_gym.train.vec_env import Sb3VecEnv, ScaledRewards

    vector_env: Any = make_training_envs(config)
    mixture = mixture_of(vector_env)
    folder.mkdir(parents=True, exist_ok=True)
    if evidence is not None:
        vector_env = evidence.recorder(vector_env)
    try:
        config.check_actions(vector_env.single_action_space)
        with reproducible():
            episodes = VecMonitor(Sb3VecEnv(vector_env, info_keys=("success",)))
            scaled = ScaledRewards(episodes, config.reward_scale)  # for the learner alone
            model = make_model(config, scaled, mixture.mean_period)
            episodes.seed(config.first_lane_seed)
            logs = folder / "tensorboard"
            outputs: list[Any] = [TensorBoardOutputFormat(str(logs))] if tensorboard else []
            model.set_logger(Logger(str(logs) if tensorboard else None, outputs))
            start = time.perf_counter()
            with translate_training_errors(config, mixture):
                model.learn(config.total_steps, callback=progress_callback(report))
            seconds = time.perf_counter() - start
            model.logger.close()
            zip_bytes = model_to_bytes(model)
    finally:
        vector_env.close()
    card = make_card(config, mixture, "sb3", seconds, recent_episode_stats(model))
    trained = write_policy(folder, zip_bytes, card, vector_env.single_action_space)
    if evidence is not None:
        vector_env.commit(evidence.batch)
    return trained


def progress_callback(
    report: Callable[[int, str], object],
) -> Callable[[dict[str, Any], dict[str, Any]], bool]:
    """A callback for SB3, which calls it after every step of the environments."""
    done, words, ended = 0, "", False

    def callback(variables: dict[str, Any], _: dict[str, Any]) -> bool:
        nonlocal done, words, ended
        model = variables["self"]
        if ended:  # SB3 counts the episodes of a step after this call
            words = format_episode_stats(recent_episode_stats(model))
        report(model.num_timesteps - done, words)
        done, ended = model.num_timesteps, variables["dones"].any()
        return True

    return callback


def recent_episode_stats(model: Any) -> dict[str, Any]:
    """The last (up to 100) episodes of training."""
    returns = [float(episode["r"]) for episode in model.ep_info_buffer]
    return episode_summary(returns, [float(success) for success in model.ep_success_buffer])


def model_to_bytes(model: Any) -> bytes:
    """The bytes of a model's zip."""
    buffer = io.BytesIO()
    model.save(buffer, exclude=["tensorboard_log"])
    return buffer.getvalue()


if __name__ == "__main__":
    from integ_gym.train.command import training_command

    sys.exit(training_command(prog="python train/ppo.py"))
