"""Symbols, which stand for numbers that are known when a traced function runs."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from integ_gym.envs.tracing.trace import Trace


class NotTraceable(TypeError):
    """A function that needs to know the value of a component while it is traced."""


class Symbol:
    """A number or truth value, or one per lane, that is known when the traced function runs."""

    __slots__ = (
        "arguments", "block", "boolean", "depth", "name", "raising", "statement", "template",
        "trace", "uses",
    )  # fmt: skip
    __array_ufunc__ = None

    def __init__(
        self,
        trace: Trace,
        template: str,
        arguments: tuple[Any, ...] = (),
        boolean: bool = False,
        name: str = "",
        statement: bool = False,
    ) -> None:
        self.trace = trace
        self.block = trace.block
        self.template = template
        self.arguments = arguments
        self.boolean = boolean
        self.name = name
        self.statement = statement
        self.raising = statement or (trace.dialect.raises and _can_raise(template, arguments))
        self.uses = 0
        self.depth = 0

    def __bool__(self) -> bool:
        raise NotTraceable("the truth of a component is not known while a function is traced")

    __float__ = __int__ = __index__ = __iter__ = __len__ = __bool__
    __hash__ = object.__hash__

    def __add__(self, other: Any) -> Any:
        return self.trace.note("{0} + {1}", self, other)

    def __radd__(self, other: Any) -> Any:
        return self.trace.note("{0} + {1}", other, self)

    def __sub__(self, other: Any) -> Any:
        return self.trace.note("{0} - {1}", self, other)

    def __rsub__(self, other: Any) -> Any:
        return self.trace.note("{0} - {1}", other, self)

    def __mul__(self, other: Any) -> Any:
        return self.trace.note("{0} * {1}", self, other)

    def __rmul__(self, other: Any) -> Any:
        return self.trace.note("{0} * {1}", other, self)

    def __truediv__(self, other: Any) -> Any:
        return self.trace.note("{0} / {1}", self, other)

    def __rtruediv__(self, other: Any) -> Any:
        return self.trace.note("{0} / {1}", other, self)

    def __mod__(self, other: Any) -> Any:
        return self.trace.note("{0} % {1}", self, other)

    def __pow__(self, other: Any) -> Any:
        return self.trace.note("{0} ** {1}", self, other)

    def __rmod__(self, other: Any) -> Any:
        return self.trace.note("{0} % {1}", other, self)

    def __rpow__(self, other: Any) -> Any:
        return self.trace.note("{0} ** {1}", other, self)

    def __neg__(self) -> Any:
        return self.trace.note("-{0}", self)

    def __pos__(self) -> Any:
        return self

    def __abs__(self) -> Any:
        return self.trace.note("abs({0})", self)

    def __lt__(self, other: Any) -> Any:
        return self.trace.note("{0} < {1}", self, other, boolean=True)

    def __le__(self, other: Any) -> Any:
        return self.trace.note("{0} <= {1}", self, other, boolean=True)

    def __gt__(self, other: Any) -> Any:
        return self.trace.note("{0} > {1}", self, other, boolean=True)

    def __ge__(self, other: Any) -> Any:
        return self.trace.note("{0} >= {1}", self, other, boolean=True)

    def __eq__(self, other: Any) -> Any:
        if self.boolean and other is False:
            return self.trace.note(self.trace.dialect.negation, self, boolean=True)
        return self.trace.note("{0} == {1}", self, other, boolean=True)

    def __ne__(self, other: Any) -> Any:
        return self.trace.note("{0} != {1}", self, other, boolean=True)

    def __and__(self, other: Any) -> Any:
        return self.trace.both(self, other, absorbing=False)

    def __rand__(self, other: Any) -> Any:
        return self.trace.both(self, other, absorbing=False)

    def __or__(self, other: Any) -> Any:
        return self.trace.both(self, other, absorbing=True)

    def __ror__(self, other: Any) -> Any:
        return self.trace.both(self, other, absorbing=True)


def _can_raise(template: str, arguments: tuple[Any, ...]) -> bool:
    """Whether an operation can raise an ``ArithmeticError`` in the scalar world."""
    if template == "{0} ** {1}":
        return True
    if template not in ("{0} / {1}", "{0} % {1}"):
        return False
    return isinstance(arguments[1], Symbol) or arguments[1] == 0


def plain(value: Any) -> Any:
    """A symbol, or a constant of Python's own type.

    Raises:
        NotTraceable: for a constant that is none of a number, a truth value and a text.
    """
    if isinstance(value, Symbol) or type(value) in (bool, int, float, str):
        return value
    own = value.item() if getattr(value, "shape", None) == () else value
    if type(own) not in (bool, int, float, str):
        raise NotTraceable(f"a constant of type {type(value).__name__} is not traced")
    return own


def identity(value: Any) -> Any:
    """What tells two operands apart: equal numbers of one type and sign are one."""
    if isinstance(value, Symbol):
        return id(value)
    return type(value), repr(value)


def same(a: Any, b: Any) -> bool:
    return a is b or bool(identity(a) == identity(b))


def is_boolean(value: Any) -> bool:
    return value.boolean if isinstance(value, Symbol) else isinstance(value, bool)


def symbols_in(value: Any) -> list[Symbol]:
    """Symbols in a result, as often as they stand there."""
    if isinstance(value, dict):
        return [symbol for part in value.values() for symbol in symbols_in(part)]
    if isinstance(value, tuple):
        return [symbol for part in value for symbol in symbols_in(part)]
    return [value] if isinstance(value, Symbol) else []
