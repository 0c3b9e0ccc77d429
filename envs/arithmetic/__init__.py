"""The arithmetic that physics is written in: floats, NumPy arrays, JAX arrays and symbols.

Knows numbers alone. Everything that computes with a plant's state is written against `Ops`.
"""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from .array_ops import ARRAY, rows_of
    from .jax_ops import JaxOps, jax, jnp
    from .ops import FLOAT32_MAX, SCALAR, Carry, Component, Components, Ops, repeat
    from .trees import leaves_of, map_leaves
else:
    __getattr__, __dir__ = lazy_door(__name__)
