"""Symbols, which stand for numbers that are known when a traced function runs."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .trace import Trace


class NotTraceable(TypeError):
    """A function that needs to know the value of a component while it is traced."""


Operator = Callable[["Symbol", Any], Any]


def _operator(template: str, of_truths: bool = False) -> tuple[Operator, Operator]:
    """An operation with the symbol on the left, and with the symbol on the right."""

    def left(self: Symbol, other: Any) -> Any:
        return noted(self, self, other)

    def right(self: Symbol, other: Any) -> Any:
        return noted(self, other, self)

    def noted(self: Symbol, *operands: Any) -> Any:
        truths = of_truths and all(map(is_boolean, operands))
        if not truths:
            check_numbers(*operands)
        return self.trace.note(self.trace.dialect.operator(template), *operands, boolean=truths)

    return left, right


def check_numbers(*operands: Any) -> None:
    """Refuse arithmetic on truth values alone, of which the worlds make different things.

    Raises:
        NotTraceable: for it.
    """
    if all(map(is_boolean, operands)):
        raise NotTraceable(
            "arithmetic on truth values is not the same for floats and arrays; "
            "`ops.where(x, 1.0, 0.0)` makes a number of one"
        )


def _comparison(template: str) -> Operator:
    def compare(self: Symbol, other: Any) -> Any:
        return self.trace.note(self.trace.dialect.operator(template), self, other, boolean=True)

    return compare


_EQUAL = _comparison("{0} == {1}")


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

    __add__, __radd__ = _operator("{0} + {1}")
    __sub__, __rsub__ = _operator("{0} - {1}")
    __mul__, __rmul__ = _operator("{0} * {1}", of_truths=True)
    __truediv__, __rtruediv__ = _operator("{0} / {1}")
    __mod__, __rmod__ = _operator("{0} % {1}")
    __pow__, __rpow__ = _operator("{0} ** {1}")
    __lt__, __gt__ = _comparison("{0} < {1}"), _comparison("{0} > {1}")
    __le__, __ge__ = _comparison("{0} <= {1}"), _comparison("{0} >= {1}")
    __ne__ = _comparison("{0} != {1}")

    def __eq__(self, other: Any) -> Any:
        if self.boolean and other is False:
            return self.trace.note(self.trace.dialect.template("logical_not"), self, boolean=True)
        return _EQUAL(self, other)

    def __neg__(self) -> Any:
        check_numbers(self)
        return self.trace.note("-{0}", self)

    def __pos__(self) -> Any:
        return self

    def __abs__(self) -> Any:
        check_numbers(self)
        return self.trace.note(self.trace.dialect.template("abs"), self)

    def __and__(self, other: Any) -> Any:
        return self.trace.both(self, other, absorbing=False)

    def __or__(self, other: Any) -> Any:
        return self.trace.both(self, other, absorbing=True)

    __rand__, __ror__ = __and__, __or__


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
    own = value.item() if getattr(value, "shape", None) == () else value
    if not isinstance(own, Symbol) and type(own) not in (bool, int, float, str):
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
