"""Python source of functions over components: run once on symbols, written down, compiled.

A function written for :class:`integ_gym.envs.arithmetic.ops.Ops` is called with symbols in place of floats or
arrays. Every operation is noted, equal ones once; what remains is a function of floats, or of
arrays, without calls, tuples and attribute look-ups in between, whose operations are those of the
scalar, or of the array world.
"""

from .compiling import Repeated, compiled, repeated
from .dialects import ARRAYS, SCALARS, Dialect, Unusual
from .symbols import NotTraceable

__all__ = [
    "ARRAYS",
    "SCALARS",
    "Dialect",
    "NotTraceable",
    "Repeated",
    "Unusual",
    "compiled",
    "repeated",
]
