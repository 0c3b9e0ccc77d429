"""The environments as pure functions of JAX arrays: for ``jit``, ``vmap`` and ``scan``.

Follows the interface of :class:`gymnasium.experimental.functional.FuncEnv`. Its physics, rewards
and ledger are those of the other environments, run on JAX arrays.
"""

from .environment import FunctionalEnv
from .mixture import make
from .params import Params, start_range

__all__ = ["FunctionalEnv", "Params", "make", "start_range"]
