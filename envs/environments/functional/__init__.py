"""The environments as pure functions of JAX arrays: for ``jit``, ``vmap`` and ``scan``.

Follows the interface of :class:`gymnasium.experimental.functional.FuncEnv`. Its physics, rewards
and ledger are those of the other environments, run on JAX arrays.
"""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from .environment import FunctionalEnv
    from .mixture import make
    from .params import Params, start_range
else:
    __getattr__, __dir__ = lazy_door(__name__)
