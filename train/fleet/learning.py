"""PPO of many policies at once: their weights, and one update of all of them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from itertools import pairwise
from threading import Thread
from typing import Any, NamedTuple

import numpy as np
from gymnasium.spaces import Space
from numpy.typing import NDArray

from integ_gym.envs.ops.jax_ops import jax, jnp
from integ_gym.envs.ops.ops import Components
from integ_gym.envs.transition import EnvState
from integ_gym.support.optional import not_installed

from ..ppo import model_to_bytes, reproducible

Weights = NDArray[np.float32]

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


def _initial_weights(rng: np.random.Generator, sizes: Sequence[int], outputs: int) -> list[Weights]:
    """One (2, out, in) array per layer."""
    hidden = [
        np.stack([orthogonal(rng, b, a, HIDDEN_GAIN) for _ in range(2)]) for a, b in pairwise(sizes)
    ]
    critic = np.zeros((outputs, sizes[-1]), dtype=np.float32)
    critic[:1] = orthogonal(rng, 1, sizes[-1], CRITIC_GAIN)
    return [*hidden, np.stack([orthogonal(rng, outputs, sizes[-1], ACTOR_GAIN), critic])]


def orthogonal(rng: np.random.Generator, rows: int, columns: int, gain: float) -> Weights:
    """A random matrix with orthonormal rows or columns, times ``gain``, shape (rows, columns).

    Source: Saxe, McClelland and Ganguli (2014), *Exact solutions to the nonlinear dynamics of
    learning in deep linear neural networks*, arXiv:1312.6120.
    """
    q, r = np.linalg.qr(rng.standard_normal((max(rows, columns), min(rows, columns))))
    q *= np.sign(np.diag(r))
    return (gain * (q if rows >= columns else q.T)).astype(np.float32)


def state_dict(stack: Stack, policy: int) -> dict[str, Weights]:
    """Weights of one policy under the names that SB3's `ActorCriticPolicy` gives them."""
    entries: dict[str, Weights] = {}
    for layer, (weight, bias) in enumerate(zip(stack.weights, stack.biases, strict=True)):
        last = layer == len(stack.weights) - 1
        for side, net in enumerate(("policy", "value")):
            prefix = f"mlp_extractor.{net}_net.{2 * layer}"
            outputs = weight.shape[2]
            if last:
                prefix = "action_net" if side == 0 else "value_net"
                outputs = outputs if side == 0 else 1
            entries[f"{prefix}.weight"] = np.array(weight[policy, side, :outputs], dtype=np.float32)
            entries[f"{prefix}.bias"] = np.array(bias[policy, side, :outputs], dtype=np.float32)
    if stack.log_std.shape[1]:
        entries["log_std"] = np.array(stack.log_std[policy], dtype=np.float32)
    return entries


def can_save() -> bool:
    """Whether what :func:`zip_of_weights` needs is installed."""
    return not not_installed(("stable_baselines3", "torch"))


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
    """Of a mixture with several control periods, each member's: shape (policies, members)."""
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


def split(keys: Array, count: int) -> tuple[Array, ...]:
    """``count`` new keys for every policy."""
    return tuple(jnp.moveaxis(jax.vmap(lambda key: jax.random.split(key, count))(keys), 1, 0))


def draw(sample: Callable[..., Array], keys: Array, shape: tuple[int, ...]) -> Array:
    """Random numbers of shape (policies, *shape), each policy's from its own key."""
    return jax.vmap(lambda key: sample(key, shape))(keys)


_LOG_ROOT_2PI = 0.5 * math.log(2.0 * math.pi)

ACTIVATIONS: dict[str, Callable[[Array], Array]] = {
    "Tanh": jnp.tanh,
    "ReLU": jax.nn.relu,
    "ReLU6": jax.nn.relu6,
    "LeakyReLU": partial(jax.nn.leaky_relu, negative_slope=0.01),
    "ELU": jax.nn.elu,
    "SELU": jax.nn.selu,
    "SiLU": jax.nn.silu,
    "GELU": partial(jax.nn.gelu, approximate=False),
    "Mish": jax.nn.mish,
    "Sigmoid": jax.nn.sigmoid,
    "Softplus": jax.nn.softplus,
    "Softsign": jax.nn.soft_sign,
}


@jax.custom_vjp
def affine(weight: Array, bias: Array, x: Array) -> Array:
    """W x + b for stacks: (…, o, i), (…, o), (…, i, n) to (…, o, n)."""
    return weight @ x + bias[..., None]


def _affine_forward(weight: Array, bias: Array, x: Array) -> tuple[Array, tuple[Array, Array]]:
    return affine(weight, bias, x), (weight, x)


def _affine_backward(residuals: tuple[Array, Array], dy: Array) -> tuple[Array, Array, Array]:
    """Sums over the batch as matrix products, which XLA does faster than its own reductions."""
    weight, x = residuals
    dw = jnp.einsum("...on,...in->...oi", dy, x)
    db = jnp.einsum("...on,n->...o", dy, jnp.ones(dy.shape[-1], dy.dtype))
    if weight.shape[-2] <= 2:
        dx = sum(weight[..., o, :, None] * dy[..., o, None, :] for o in range(weight.shape[-2]))
    else:
        dx = jnp.einsum("...oi,...on->...in", weight, dy)
    return dw, db, dx


affine.defvjp(_affine_forward, _affine_backward)


def outputs(stack: Stack, activation: str, observations: Array) -> Array:
    """What the last layers give.

    Args:
        stack: weights; their second axis may be 1, for actor or critic alone.
        activation: key of `ACTIVATIONS`.
        observations: (policies, obs, n).

    Returns:
        (policies, 2, outputs, n), actor first.
    """
    sides = stack.weights[0].shape[1]
    features: Array = observations
    for layer, (weight, bias) in enumerate(zip(stack.weights, stack.biases, strict=True)):
        if layer:
            features = affine(weight, bias, ACTIVATIONS[activation](features))
        else:
            policies, _, out, width = weight.shape
            joint = affine(
                weight.reshape(policies, sides * out, width), bias.reshape(policies, -1), features
            )
            features = joint.reshape(policies, sides, out, -1)
    return features


def one_side(stack: Stack, side: int) -> Stack:
    """The actors (0) or the critics (1) alone."""
    return stack._replace(
        weights=tuple(w[:, side : side + 1] for w in stack.weights),
        biases=tuple(b[:, side : side + 1] for b in stack.biases),
    )


def log_prob_and_entropy(head: Array, log_std: Array, actions: Array) -> tuple[Array, Array]:
    """Of actions under the actor's outputs.

    Args:
        head: (policies, outputs, n): means, or logits where ``log_std`` is empty.
        log_std: (policies, action_dim).
        actions: as in :class:`integ_gym.train.fleet.learning.Batch`.

    Returns:
        (policies, n), and the entropy: the same shape, or (policies, 1).
    """
    if log_std.shape[1]:
        spread = log_std[..., None]
        scaled = (actions - head) * jnp.exp(-spread)
        log_prob = (-0.5 * scaled * scaled - spread - _LOG_ROOT_2PI).sum(1)
        return log_prob, (0.5 + _LOG_ROOT_2PI + spread).sum(1)
    normalized = jax.nn.log_softmax(head, axis=1)
    chosen = jnp.arange(head.shape[1])[:, None] == actions
    log_prob = jnp.where(chosen, normalized, 0.0).sum(1)
    return log_prob, -(jnp.exp(normalized) * normalized).sum(1)


ADAM_DECAY = (0.9, 0.999)
ADAM_EPSILON = 1e-5
_NORM_EPSILON = 1e-6
_ADVANTAGE_EPSILON = 1e-8
_INDEX_BITS = 16
"""Rollouts up to 2 to this many decisions are shuffled by one packed sort."""


def update(
    algorithm: Algorithm,
    stack: Stack,
    adam: Adam,
    batch: Batch,
    orders: Array,
    knobs: Knobs,
    rate: Array,
) -> tuple[Stack, Adam]:
    """Learn from one rollout.

    Args:
        algorithm: its structure.
        stack: weights.
        adam: state of the optimizer.
        batch: the rollout.
        orders: int32 (policies, epochs, n): the order of the decisions in each epoch.
        knobs: hyperparameters.
        rate: (policies,).
    """
    packed = jnp.concatenate(
        [batch.observations, batch.actions, *(x[:, None] for x in batch[2:])], axis=1
    )
    rows = jnp.swapaxes(packed, 1, 2)
    sizes = batch.observations.shape[1], batch.actions.shape[1]
    policies, total, width = rows.shape
    batch_size = algorithm.batch_size

    def learn(carry: Any, part: Array) -> Any:
        stack, adam, active = carry
        minibatch = _unpack(part, sizes)
        gradient, divergence = _gradient(algorithm, stack, minibatch, knobs)
        if not algorithm.stops_early:
            return (*_adam_step(stack, adam, gradient, knobs, rate), active), None
        active = active & (divergence <= 1.5 * knobs.target_kl)
        learned = _adam_step(stack, adam, gradient, knobs, rate)
        chosen = jax.tree.map(
            lambda new, old: jnp.where(_over(active, new), new, old), learned, (stack, adam)
        )
        return (*chosen, active), None

    def epoch(carry: Any, order: Array) -> Any:
        shuffled = jnp.take_along_axis(rows, order[..., None], axis=1)
        parts = shuffled.reshape(policies, total // batch_size, batch_size, width)
        carry, _ = jax.lax.scan(learn, carry, parts.transpose(1, 0, 3, 2))
        return carry, None

    start = (stack, adam, jnp.ones(policies, bool))
    (stack, adam, _), _ = jax.lax.scan(epoch, start, jnp.swapaxes(orders, 0, 1))
    return stack, adam


def learning_rate(algorithm: Algorithm, knobs: Knobs, iteration: Array) -> Array:
    """Linear in the share of decisions taken, after the rollout that is learned from."""
    done = jnp.minimum(iteration * algorithm.rollout / knobs.total_steps, 1.0)
    return knobs.learning_rate + done * (knobs.learning_rate_end - knobs.learning_rate)


def permutations(algorithm: Algorithm, keys: Array) -> Array:
    """Orders of the rollout's decisions, int32 (policies, n_epochs, rollout)."""
    size = algorithm.rollout
    bits = draw(jax.random.bits, keys, (algorithm.n_epochs, size))
    if size <= 1 << _INDEX_BITS:
        mask = jnp.uint32((1 << max(1, (size - 1).bit_length())) - 1)
        packed = (bits & ~mask) | jnp.arange(size, dtype=jnp.uint32)
        order = jnp.sort(packed, axis=-1) & mask
    else:
        order = jnp.argsort(bits, axis=-1)
    return order.astype(jnp.int32)


def advantages_of(
    reward: Array,
    values: Array,
    next_values: Array,
    terminated: Array,
    truncated: Array,
    knobs: Knobs,
    member: Array,
) -> Array:
    """Generalized advantage estimates, (n_steps, policies, n_envs).

    ``next_values`` are the critic's at the state after each step, before a reset; ``member`` is the
    mixture's that the episode runs on, by whose control period it is discounted. Nothing is
    bootstrapped where an episode was terminated, and nothing passes an episode's end.
    Source: Schulman et al. (2016), *High-dimensional continuous control using generalized
    advantage estimation*, arXiv:1506.02438.
    """
    gamma = knobs.gamma[:, None]
    if knobs.gamma.ndim > 1:
        gamma = jax.vmap(lambda own, drawn: own[drawn], (0, 1), 1)(knobs.gamma, member)
    goes_on = jnp.where(terminated | truncated, 0.0, 1.0)
    decay = gamma * knobs.gae_lambda[:, None] * goes_on
    bootstrapped = jnp.where(terminated, 0.0, next_values)
    delta = reward + gamma * bootstrapped - values

    def back(later: Array, now: tuple[Array, Array]) -> tuple[Array, Array]:
        advantage = now[0] + now[1] * later
        return advantage, advantage

    _, advantages = jax.lax.scan(
        back, jnp.zeros_like(delta[0]), (delta, decay), reverse=True, unroll=8
    )
    return advantages


def _gradient(
    algorithm: Algorithm, stack: Stack, batch: Batch, knobs: Knobs
) -> tuple[Stack, Array]:
    """Gradient of every policy's loss, and its approximate divergence from the rollout's."""
    advantages = batch.advantages
    if algorithm.normalize_advantage and advantages.shape[1] > 1:
        mean = advantages.mean(1, keepdims=True)
        spread = jnp.std(advantages, axis=1, keepdims=True, ddof=1)
        advantages = (advantages - mean) / (spread + _ADVANTAGE_EPSILON)
    clip = knobs.clip_range[:, None]

    def loss(stack: Stack) -> tuple[Array, Array]:
        out = outputs(stack, algorithm.activation, batch.observations)
        log_prob, entropy = log_prob_and_entropy(out[:, 0], stack.log_std, batch.actions)
        log_ratio = log_prob - batch.log_probs
        ratio = jnp.exp(log_ratio)
        clipped = jnp.clip(ratio, 1.0 - clip, 1.0 + clip)
        surrogate = jnp.minimum(advantages * ratio, advantages * clipped).mean(1)
        error = batch.returns - out[:, 1, 0]
        losses = (
            -surrogate - knobs.ent_coef * entropy.mean(1) + knobs.vf_coef * (error * error).mean(1)
        )
        return losses.sum(), ((ratio - 1.0) - log_ratio).mean(1)

    gradient, divergence = jax.grad(loss, has_aux=True)(stack)
    return gradient, divergence


def _adam_step(
    stack: Stack, adam: Adam, gradient: Stack, knobs: Knobs, learning_rate: Array
) -> tuple[Stack, Adam]:
    """One step of Adam along the gradient, scaled down to the largest norm.

    Source: Kingma and Ba (2015), *Adam: a method for stochastic optimization*, arXiv:1412.6980.
    """
    squares = [(g * g).reshape(g.shape[0], -1).sum(1) for g in jax.tree.leaves(gradient)]
    norm = jnp.sqrt(sum(squares[1:], squares[0]))
    scale = jnp.minimum(1.0, knobs.max_grad_norm / (norm + _NORM_EPSILON))
    gradient = jax.tree.map(lambda g: g * _over(scale, g), gradient)
    count = adam.count + 1.0
    first, second = ADAM_DECAY
    size = learning_rate / (1.0 - first**count)
    root = 1.0 / jnp.sqrt(1.0 - second**count)
    mean = jax.tree.map(lambda m, g: first * m + (1.0 - first) * g, adam.mean, gradient)
    square = jax.tree.map(lambda s, g: second * s + (1.0 - second) * g * g, adam.square, gradient)
    stack = jax.tree.map(
        lambda p, m, s: p - _over(size, p) * m / (jnp.sqrt(s) * _over(root, p) + ADAM_EPSILON),
        stack, mean, square,
    )  # fmt: skip
    return stack, Adam(mean, square, count)


def _unpack(part: Array, sizes: tuple[int, int]) -> Batch:
    observations, actions, rest = jnp.split(part, (sizes[0], sum(sizes)), axis=1)
    return Batch(observations, actions, *jnp.moveaxis(rest, 1, 0))


def _over(per_policy: Array, like: Array) -> Array:
    """Shape (policies,) as one that broadcasts against ``like``."""
    return per_policy.reshape(per_policy.shape + (1,) * (like.ndim - 1))
