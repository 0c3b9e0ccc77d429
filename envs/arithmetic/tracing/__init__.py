"""Source of functions over components, in Python or JavaScript: run once on symbols, written down.

A function written for `Ops` is called with symbols in place of floats or arrays. What it does to
them is a trace: operations and loops. The trace is written as one function without objects or
calls of our own; in Python it is compiled, and computes the same numbers to the last bit. Knows
`Ops`, not what is traced.
"""

from typing import TYPE_CHECKING

from integ_gym.support import lazy_door

if TYPE_CHECKING:
    from .compiling import Repeated, compiled, looped, repeated, source_of
    from .dialects import ARRAYS, JAVASCRIPT, SCALARS, Unusual
    from .symbols import NotTraceable
else:
    __getattr__, __dir__ = lazy_door(__name__)
