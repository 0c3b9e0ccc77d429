"""Random numbers of several policies, each from a key of its own."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from integ_gym.envs.ops.jax_ops import jax, jnp

Array = Any


def split(keys: Array, count: int) -> tuple[Array, ...]:
    """``count`` new keys for every policy."""
    return tuple(jnp.moveaxis(jax.vmap(lambda key: jax.random.split(key, count))(keys), 1, 0))


def draw(sample: Callable[..., Array], keys: Array, shape: tuple[int, ...]) -> Array:
    """Random numbers of shape (policies, *shape), each policy's from its own key."""
    return jax.vmap(lambda key: sample(key, shape))(keys)
