"""Components as JAX arrays: traceable by ``jit``, ``vmap`` and ``scan``."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar

import numpy as np

from integ_gym.support.errors import InputTypeError
from integ_gym.support.optional import missing_package

from .ops import Carry, Component, Components, keep_condition

try:
    import jax
    import jax.numpy as jnp
except ModuleNotFoundError as error:
    raise missing_package("jax", "fleet") from error

__all__ = ["JaxOps", "jax", "jnp"]


class JaxOps:
    """Components are arrays of one dtype, float32 or float64.

    Args:
        dtype: float type of the components; sets :attr:`epsilon`.
    """

    sin = staticmethod(jnp.sin)
    cos = staticmethod(jnp.cos)
    floor = staticmethod(jnp.floor)
    sqrt = staticmethod(jnp.sqrt)
    tanh = staticmethod(jnp.tanh)
    where: ClassVar[Any] = staticmethod(jnp.where)
    minimum = staticmethod(jnp.minimum)
    maximum = staticmethod(jnp.maximum)
    isfinite = staticmethod(jnp.isfinite)
    any = staticmethod(jnp.any)
    assume_true = assume_false = staticmethod(keep_condition)

    def __init__(self, dtype: str = "float64") -> None:
        self.epsilon = float(np.finfo(dtype).eps)

    def while_loop(
        self, condition: Callable[[Carry], Component], body: Callable[[Carry], Carry], carry: Carry
    ) -> Carry:
        """``lax.while_loop`` that freezes finished lanes, batched or under ``vmap``."""
        shape = jnp.broadcast_shapes(*(jnp.shape(c) for c in (*carry, condition(carry))))
        start: Any = tuple(jnp.broadcast_to(jnp.asarray(c), shape) for c in carry)

        def masked_body(current: Any) -> Any:
            active = condition(current)
            return tuple(
                jnp.where(active, new, old).astype(jnp.result_type(old))
                for new, old in zip(body(current), current, strict=True)
            )

        end: Any = jax.lax.while_loop(lambda c: jnp.any(condition(c)), masked_body, start)
        return end  # type: ignore[no-any-return]

    def repeat(
        self, count: int | jax.Array, body: Callable[[Component, Carry], Carry], carry: Carry
    ) -> Carry:
        """``lax.fori_loop``, whose count may be traced; a single application is inlined.

        Where lanes have counts of their own, those that are done wait for the others.
        """
        if isinstance(count, int) and count == 1:
            return body(0, carry)
        if jnp.ndim(count):
            body, count = _until_done(count, body), jnp.max(count)
        shapes = jax.eval_shape(lambda c: body(0, c), carry)
        start = jax.tree.map(
            lambda x, like: jnp.broadcast_to(x, like.shape).astype(like.dtype), carry, shapes
        )
        return jax.lax.fori_loop(0, count, body, start)  # type: ignore[no-any-return]

    def foreign(
        self, function: Callable[..., Components], arguments: Components, truths: tuple[bool, ...]
    ) -> Components:
        """Not possible: only what is made of JAX's own operations can be compiled."""
        raise InputTypeError("an engine outside JAX cannot be compiled; use its NumPy environment")


def _until_done(
    count: Component, body: Callable[[Component, Carry], Carry]
) -> Callable[[Component, Carry], Carry]:
    """``body`` in the lanes that have not had it ``count`` times."""

    def applied(index: Component, carry: Carry) -> Carry:
        kept: Carry = jax.tree.map(
            lambda new, old: jnp.where(index < count, new, old), body(index, carry), carry
        )
        return kept

    return applied
