"""Actor-critics of several policies as stacks of small matrices, and the actions' distribution.

Within a network, batches are the last axis, which is the fastest order for small matrix products
on a CPU.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any

from integ_gym.envs.ops.jax_ops import jax, jnp

from ..sb3.initial_weights import Stack

Array = Any

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


def _affine_backward(kept: tuple[Array, Array], dy: Array) -> tuple[Array, Array, Array]:
    """Sums over the batch as matrix products, which XLA does faster than its own reductions."""
    weight, x = kept
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
        actions: as in :class:`integ_gym.train.fleet.types.Batch`.

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
