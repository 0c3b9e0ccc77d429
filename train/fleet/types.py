"""What the fleet's compiled programs take and give: arrays of several policies, (policies, …)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

from integ_gym.envs.ops.ops import Components
from integ_gym.envs.transition import EnvState

from ..sb3.initial_weights import Stack

Array = Any


@dataclass(frozen=True)
class Algorithm:
    """Hyperparameters that decide the program's structure; named as in `PPOConfig`."""

    n_envs: int
    n_steps: int
    batch_size: int
    n_epochs: int
    activation: str
    normalize_advantage: bool
    stops_early: bool
    """Whether there is a `target_kl`."""

    @property
    def rollout(self) -> int:
        """Decisions of one policy between two updates."""
        return self.n_envs * self.n_steps


class Knobs(NamedTuple):
    """Hyperparameters that are values, float32, shape (policies,); named as in `PPOConfig`."""

    learning_rate: Array
    learning_rate_end: Array
    total_steps: Array
    gamma: Array
    gae_lambda: Array
    clip_range: Array
    ent_coef: Array
    vf_coef: Array
    max_grad_norm: Array
    target_kl: Array
    reward_scale: Array


class Adam(NamedTuple):
    """State of the optimizer."""

    mean: Stack
    square: Stack
    count: Array
    """Steps taken, float32, shape (policies,)."""


class Learner(NamedTuple):
    """All that a chunk carries from one rollout to the next."""

    stack: Stack
    adam: Adam
    env: EnvState
    """Components of shape (policies, n_envs)."""
    noise: Components
    member: Components
    """In a mixture: the member that each lane has drawn, int32; else empty."""
    keys: Array
    """Random keys, shape (policies,)."""
    iteration: Array
    """Rollouts so far, int32."""


class Batch(NamedTuple):
    """Decisions to learn from; the last axis counts them."""

    observations: Array
    """(policies, obs, n)."""
    actions: Array
    """(policies, action_dim, n): before clipping; or (policies, 1, n): number of the action."""
    log_probs: Array
    """(policies, n)."""
    advantages: Array
    returns: Array


class Trail(NamedTuple):
    """What a rollout did, arrays of shape (n_steps, policies, n_envs)."""

    rewards: Array
    """Unscaled."""
    ended: Array
    success: Array
    begun: Array
    """Whether an episode begins with this step."""
    member: Array
    """The member of the mixture that the episode runs on, int32; 0 without one."""
    rows: Array
    """Evidence after each step, (entries, n_steps, policies, n_envs)."""
    first_rows: Array
    """Evidence before each step, of the entries that are not zero after a reset."""
