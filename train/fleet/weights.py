"""Weights of many actor-critics at once, and of one as stable-baselines3 keeps them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import cache
from itertools import pairwise
from threading import Thread
from typing import Any, NamedTuple

import numpy as np
from gymnasium.spaces import Space
from numpy.typing import NDArray

from integ_gym.support.optional import absent

from ..ppo import model_to_bytes, reproducible

Array = NDArray[np.float32]

HIDDEN_GAIN = math.sqrt(2.0)
ACTOR_GAIN = 0.01
CRITIC_GAIN = 1.0


class Stack(NamedTuple):
    """Weights of several actor-critics; entries are NumPy or JAX arrays."""

    weights: tuple[Any, ...]
    biases: tuple[Any, ...]
    log_std: Any
    """Log of the exploration noise, shape (policies, action_dim); action_dim 0 for `Discrete`."""


def initial_stack(
    seeds: Sequence[int], sizes: Sequence[int], outputs: int, log_std_init: Sequence[float] | None
) -> Stack:
    """Orthogonal weights with SB3's gains, zero biases.

    Args:
        seeds: one per policy.
        sizes: of the observation and of the hidden layers.
        outputs: of the actor: action dimensions, or number of actions.
        log_std_init: one per policy, or None for a `Discrete` action space.
    """
    policies = [_initial_weights(np.random.default_rng(s), sizes, outputs) for s in seeds]
    weights = tuple(np.stack(layer) for layer in zip(*policies, strict=True))
    biases = tuple(np.zeros(weight.shape[:-1], dtype=np.float32) for weight in weights)
    noise = np.zeros((len(seeds), 0 if log_std_init is None else outputs), dtype=np.float32)
    if log_std_init is not None:
        noise += np.asarray(log_std_init, dtype=np.float32)[:, None]
    return Stack(weights, biases, noise)


def _initial_weights(rng: np.random.Generator, sizes: Sequence[int], outputs: int) -> list[Array]:
    """One (2, out, in) array per layer."""
    hidden = [
        np.stack([orthogonal(rng, b, a, HIDDEN_GAIN) for _ in range(2)]) for a, b in pairwise(sizes)
    ]
    critic = np.zeros((outputs, sizes[-1]), dtype=np.float32)
    critic[:1] = orthogonal(rng, 1, sizes[-1], CRITIC_GAIN)
    return [*hidden, np.stack([orthogonal(rng, outputs, sizes[-1], ACTOR_GAIN), critic])]


def orthogonal(rng: np.random.Generator, rows: int, columns: int, gain: float) -> Array:
    """A random matrix with orthonormal rows or columns, times ``gain``, shape (rows, columns).

    Source: Saxe, McClelland and Ganguli (2014), *Exact solutions to the nonlinear dynamics of
    learning in deep linear neural networks*, arXiv:1312.6120.
    """
    q, r = np.linalg.qr(rng.standard_normal((max(rows, columns), min(rows, columns))))
    q *= np.sign(np.diag(r))
    return (gain * (q if rows >= columns else q.T)).astype(np.float32)


def state_dict(stack: Stack, policy: int) -> dict[str, Array]:
    """Weights of one policy under the names that SB3's `ActorCriticPolicy` gives them."""
    named: dict[str, Array] = {}
    for layer, (weight, bias) in enumerate(zip(stack.weights, stack.biases, strict=True)):
        last = layer == len(stack.weights) - 1
        for side, net in enumerate(("policy", "value")):
            prefix = f"mlp_extractor.{net}_net.{2 * layer}"
            outputs = weight.shape[2]
            if last:
                prefix = "action_net" if side == 0 else "value_net"
                outputs = outputs if side == 0 else 1
            named[f"{prefix}.weight"] = np.array(weight[policy, side, :outputs], dtype=np.float32)
            named[f"{prefix}.bias"] = np.array(bias[policy, side, :outputs], dtype=np.float32)
    if stack.log_std.shape[1]:
        named["log_std"] = np.array(stack.log_std[policy], dtype=np.float32)
    return named


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
        return model_to_bytes(model)
