"""Components as NumPy arrays: a batch of environments, one lane each."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from .ops import Carry, Components, repeat

Array = npt.NDArray[Any]


class ArrayOps:
    """Components are float64 arrays of shape (lanes,), or scalars that broadcast to it."""

    epsilon = float(np.finfo(np.float64).eps)
    sin = staticmethod(np.sin)
    cos = staticmethod(np.cos)
    floor = staticmethod(np.floor)
    sqrt = staticmethod(np.sqrt)
    tanh = staticmethod(np.tanh)
    where = staticmethod(np.where)
    minimum = staticmethod(np.minimum)
    maximum = staticmethod(np.maximum)
    isfinite = staticmethod(np.isfinite)
    any = staticmethod(np.any)
    repeat = staticmethod(repeat)

    @staticmethod
    def usually(condition: Array, /) -> Array:
        return condition

    rarely = usually

    @staticmethod
    def while_loop(
        condition: Callable[[Carry], Array], body: Callable[[Carry], Carry], carry: Carry
    ) -> Carry:
        """Masked loop: lanes that have finished keep their values."""
        active = condition(carry)
        while np.any(active):
            kept, carry = carry, body(carry)
            if not np.all(active):
                pairs = zip(carry, kept, strict=True)
                carry = tuple(np.where(active, new, old) for new, old in pairs)  # type: ignore[assignment]
            active = condition(carry)
        return carry

    @staticmethod
    def foreign(
        function: Callable[..., Components], arguments: Components, truths: tuple[bool, ...]
    ) -> Components:
        """One lane after the other."""
        columns = [a.tolist() for a in np.broadcast_arrays(*arguments)]
        results = zip(*map(function, *columns), strict=True)
        return tuple(
            [np.array(x, dtype=bool if t else float) for x, t in zip(results, truths, strict=True)]
        )


ARRAY = ArrayOps()


def rows_of(components: Components, count: int, dtype: npt.DTypeLike = np.float64) -> Array:
    """Components, each one number or of shape (count,), as rows of shape (count, n)."""
    rows = np.empty((count, len(components)), dtype)
    for column, values in enumerate(components):
        rows[:, column] = values
    return rows
