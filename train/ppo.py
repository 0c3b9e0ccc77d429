"""Proximal policy optimization (PPO) with stable-baselines3 (SB3), from top to bottom.

    python train/ppo.py --integrator rk4 --dt 0.05

Hyperparameters (beside `TrainingConfig`, which every algorithm has), environments, model, learning,
files: what decides a result, from top to bottom. The same configuration gives the same weights bit
by bit on one machine: one thread, fixed seeds, no GPU. `integ_gym.train.fleet.training` trains many
policies at once from the same `PPOConfig`.

Source: Schulman et al. (2017), *Proximal policy optimization algorithms*, arXiv:1707.06347.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

from gymnasium.vector import VectorEnv

from integ_gym.envs.testbeds.making import make_training_environments
from integ_gym.support.executors import Cluster
from integ_gym.support.optional import require
from integ_gym.support.parameters import (
    boolean,
    finite_number,
    nonnegative,
    one_of,
    optional,
    parameter,
    positive,
)
from integ_gym.train.config import (
    TrainingConfig,
    TrainingEvidence,
    check_rollout,
    explained,
    fraction,
    whole,
)
from integ_gym.train.policy import ACTIVATIONS
from integ_gym.train.policy_files.sidecar import TrainedPolicy, write_policy
from integ_gym.train.sb3_model import Tell, last_episodes, logger, reproducible, saved, telling
from integ_gym.train.side_by_side import OnTrained, checked_runs, train_each, unheard

from .policy_files.card import make_card, mixture_of

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
        0.0, "", "log of the first exploration noise (Box)", finite_number
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        check_rollout(self)

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


# ------------------------------------------------------------------------------- learning and files


def train_run(
    config: TrainingConfig,
    folder: Path,
    evidence: TrainingEvidence | None = None,
    *,
    make_model: Callable[[Any, Any, float], Any] = make_model,
    tell: Tell = lambda steps, words: None,
    tensorboard: bool = False,
) -> TrainedPolicy:
    """Train one policy in this process.

    Nothing outside the run changes: torch's thread count and the global random states are put back.
    """
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
            model = make_model(config, scaled, mixture.setups[0].timing.control_period)
            episodes.seed(config.first_lane_seed)
            model.set_logger(logger(folder / "tensorboard" if tensorboard else None))
            start = time.perf_counter()
            with explained(config, mixture):
                model.learn(config.total_steps, callback=telling(tell))
            seconds = time.perf_counter() - start
            model.logger.close()
            zip_bytes = saved(model)
    finally:
        vector_env.close()
    card = make_card(config, mixture, "sb3", seconds, last_episodes(model))
    trained = write_policy(folder, zip_bytes, card, vector_env.single_action_space)
    if evidence is not None:
        vector_env.commit(evidence.batch)
    return trained


def train_ppo(
    configs: Sequence[PPOConfig],
    out_dirs: Sequence[str | Path],
    *,
    evidence: Sequence[TrainingEvidence] | None = None,
    progress: bool = True,
    workers: int | None = None,
    force: bool = False,
    on_trained: OnTrained = unheard,
    tensorboard: bool = True,
    executor: str | Cluster = "local",
    address: str | None = None,
) -> list[TrainedPolicy]:
    """Train policies and write each: `policy.zip`, `policy.safetensors` and `policy.json`.

    Args:
        configs: the runs; they may differ in everything.
        out_dirs: a folder for each policy.
        evidence: where the training episodes of each are recorded; None: nowhere.
        progress: show a bar on stderr.
        workers: processes; by default one per core. A single run, or the runs of a single worker
            one after another, are trained in this process.
        force: replace policies that are already there.
        on_trained: told the place of every policy in `configs` once it and its evidence are
            written.
        tensorboard: write logs beside each policy.
        executor: what runs the processes: see :func:`integ_gym.support.executors.open_cluster`.
        address: of a running cluster.

    Raises:
        OSError: if a folder cannot be used, or holds a policy and `force` is not given.
        TypeError, ValueError: for arguments that are not possible.
        ModuleNotFoundError: if the extra is missing, with the command that installs it.
        TrainingError: if a run fails or a worker is killed; finished policies stay.
    """
    require("train")
    runs = checked_runs(configs, out_dirs, evidence, force)
    run = partial(train_run, tensorboard=tensorboard)
    return train_each(run, runs, progress, workers, on_trained, executor, address)


if __name__ == "__main__":
    from integ_gym.train.command import training_command

    sys.exit(training_command(prog="python train/ppo.py"))
