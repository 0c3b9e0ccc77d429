"""The arithmetic that plants, integrators and tasks are written in: its scalar and array forms."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, Protocol, TypeAlias, TypeVar

import numpy as np
import numpy.typing as npt

from integ_gym.support.errors import IntegGymError

Component: TypeAlias = Any
"""One state variable: ``float``, ``numpy.ndarray`` or ``jax.Array``, of shape () or (lanes,)."""

Components: TypeAlias = tuple[Component, ...]
"""Generalized coordinates, velocities or forces: one entry per degree of freedom."""

Array: TypeAlias = npt.NDArray[Any]

Carry = TypeVar("Carry", bound=tuple[Any, ...])

FLOAT32_MAX = 3.4028234663852886e38
"""Largest finite float32; a larger state cannot be observed."""


class Ops(Protocol):
    """What the three worlds do differently."""

    epsilon: float
    """Machine epsilon of the components: solver tolerances scale with it."""

    def sin(self, x: Component, /) -> Component: ...

    def cos(self, x: Component, /) -> Component: ...

    def floor(self, x: Component, /) -> Component:
        """The largest whole number that is not above ``x``, as a component."""

    def sqrt(self, x: Component, /) -> Component: ...

    def tanh(self, x: Component, /) -> Component: ...

    def where(self, condition: Component, a: Component, b: Component, /) -> Component:
        """``a`` where ``condition`` holds, else ``b``; both are evaluated."""

    def minimum(self, a: Component, b: Component, /) -> Component:
        """The smaller; NaN if either is."""

    def maximum(self, a: Component, b: Component, /) -> Component:
        """The larger; NaN if either is."""

    def isfinite(self, x: Component, /) -> Component: ...

    def any(self, condition: Component, /) -> Component:
        """Whether ``condition`` holds in at least one lane."""

    def assume_true(self, condition: Component, /) -> Component:
        """``condition``, of which it is known that it holds in every lane but for rare cases.

        Code that is written for the usual case takes it for True, and hands the others back.
        """

    def assume_false(self, condition: Component, /) -> Component:
        """``condition``, of which it is known that it holds in no lane but for rare cases.

        What is wanted only where it holds, written as ``condition & …``, may then not be computed.
        """

    def while_loop(
        self,
        condition: Callable[[Carry], Component],
        body: Callable[[Carry], Carry],
        carry: Carry,
    ) -> Carry:
        """Apply ``body`` in every lane for as long as ``condition`` holds in that lane.

        ``carry`` is a flat tuple of components; a lane whose condition no longer holds keeps
        its values while others go on.
        """

    def repeat(self, count: int, body: Callable[[Component, Carry], Carry], carry: Carry) -> Carry:
        """Apply ``body(index, carry)`` for index 0 … count - 1."""

    def foreign(
        self,
        function: Callable[..., Components],
        arguments: Components,
        truths: tuple[bool, ...],
    ) -> Components:
        """Call a function of floats that is made of other than these operations.

        ``truths`` has one entry per result: whether it is a truth value.
        """


def repeat(count: int, body: Callable[[int, Carry], Carry], carry: Carry) -> Carry:
    """A Python loop: :meth:`Ops.repeat` for scalars and arrays."""
    for index in range(count):
        carry = body(index, carry)
    return carry


def keep_condition(condition: Component, /) -> Component:
    """The condition itself: :meth:`Ops.assume_true` where every case is computed."""
    return condition


def _or_nan(function: Callable[[float], float]) -> Callable[[float], float]:
    """NaN outside the function's domain."""

    def safe(x: float, /) -> float:
        try:
            return function(x)
        except ValueError:
            return math.nan

    return safe


def _tanh(x: float, /) -> float:
    """NumPy's: ``math.tanh`` differs from it in the last bit, as ``math.sin`` does not."""
    return float(np.tanh(x))


class ScalarOps:
    """Components are Python floats.

    Outside their domain ``sin``, ``cos`` and ``sqrt`` give NaN, as in the other worlds. What Python
    raises by itself (``1.0 / 0.0``, ``1e200 ** 2``) is an ``ArithmeticError``, which the
    environment turns into a divergence.
    """

    epsilon = 2.220446049250313e-16
    sin = staticmethod(_or_nan(math.sin))
    cos = staticmethod(_or_nan(math.cos))
    sqrt = staticmethod(_or_nan(math.sqrt))
    isfinite = staticmethod(math.isfinite)
    any = staticmethod(bool)
    tanh = staticmethod(_tanh)
    repeat = staticmethod(repeat)
    assume_true = assume_false = staticmethod(keep_condition)

    @staticmethod
    def floor(x: float, /) -> float:
        return x // 1.0

    @staticmethod
    def where(condition: bool, a: float, b: float, /) -> float:
        return a if condition else b

    @staticmethod
    def minimum(a: float, b: float, /) -> float:
        return a if a <= b or a != a else b

    @staticmethod
    def maximum(a: float, b: float, /) -> float:
        return a if a >= b or a != a else b

    @staticmethod
    def while_loop(
        condition: Callable[[Carry], bool], body: Callable[[Carry], Carry], carry: Carry
    ) -> Carry:
        while condition(carry):
            carry = body(carry)
        return carry

    @staticmethod
    def foreign(
        function: Callable[..., Components], arguments: Components, truths: tuple[bool, ...]
    ) -> Components:
        return function(*arguments)


SCALAR = ScalarOps()


def map_leaves(function: Callable[..., Any], tree: Any, *others: Any) -> Any:
    """``function`` of every component in nested (named) tuples, and of those that stand there in
    ``others``, which are shaped alike."""
    values = [
        map_leaves(function, *alike) if isinstance(alike[0], tuple) else function(*alike)
        for alike in zip(tree, *others, strict=True)
    ]
    return type(tree)(*values) if hasattr(tree, "_fields") else tuple(values)


def leaves_of(value: Any) -> list[Any]:
    """Components of a nested tuple, in order."""
    if isinstance(value, tuple):
        return [leaf for part in value for leaf in leaves_of(part)]
    return [value]


def rebuild(pattern: Any, leaves: Sequence[Any]) -> Any:
    """A nested tuple like ``pattern`` with other components."""
    rest = iter(leaves)
    (tree,) = map_leaves(lambda _: next(rest), (pattern,))
    return tree


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
    assume_true = assume_false = staticmethod(keep_condition)

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


def join_state(q: tuple[Any, ...], v: tuple[Any, ...]) -> tuple[Any, ...]:
    """(q, v) to state order (q0, v0, q1, v1, …); velocities last where their numbers differ."""
    if len(q) != len(v):
        return (*q, *v)
    return tuple([x for pair in zip(q, v, strict=True) for x in pair])


def split_state(state: Components) -> tuple[Components, Components]:
    """State order (q0, v0, q1, v1, …) to (q, v)."""
    return tuple(state[0::2]), tuple(state[1::2])


def along(x: Components, h: Component, slope: Components) -> Components:
    """``x + h * slope``, component by component."""
    if len(x) == 1:
        return (x[0] + h * slope[0],)
    return tuple([a + h * b for a, b in zip(x, slope, strict=True)])


def select(ops: Ops, condition: Component, new: Components, old: Components) -> Components:
    """``new`` where ``condition`` holds, else ``old``, component by component."""
    return tuple([ops.where(condition, a, b) for a, b in zip(new, old, strict=True)])


class Unusual(ArithmeticError):
    """What a traced function took for granted does not hold; ask the plain one."""


class NotTraceable(IntegGymError, TypeError):
    """A function that needs to know the value of a component while it is traced."""
