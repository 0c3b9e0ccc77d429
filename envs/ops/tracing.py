"""Traces: the operations of a function, recorded once by running it on symbols."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import compress
from typing import Any

import numpy as np

from .dialects import Dialect, call_template
from .ops import SCALAR, Carry, NotTraceable, leaves_of, rebuild

Operator = Callable[["Symbol", Any], Any]


def _operator(template: str, of_truths: bool = False) -> tuple[Operator, Operator]:
    """An operation with the symbol on the left, and with the symbol on the right."""

    def left(self: Symbol, other: Any) -> Any:
        return note(self, self, other)

    def right(self: Symbol, other: Any) -> Any:
        return note(self, other, self)

    def note(self: Symbol, *operands: Any) -> Any:
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
        raise NotTraceable(
            "a component has no truth value while a function is traced; use ops.where"
        )

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


_ROOM = 0.5
"""Part of a squared bound that a rounded sum of squares may take up."""


def sums_of_squares(condition: Any) -> list[tuple[Symbol, float]] | None:
    """Numbers and what the sum of their squares over the lanes may be, for ``condition`` to hold.

    A sum that is larger, or not finite, says nothing.

    Returns:
        None where the condition is not made by ``and`` of bounds on magnitudes and ``isfinite``.
    """
    if not isinstance(condition, Symbol):
        return None
    if condition.template == "{0} & {1}":
        parts = [sums_of_squares(argument) for argument in condition.arguments]
        return None if None in parts else [bound for part in parts for bound in part or ()]
    if condition.template == "isfinite({0})":
        return [(condition.arguments[0], sys.float_info.max)]
    if condition.template == "{0} <= {1}":
        magnitude, bound = condition.arguments
        squared = _ROOM * bound * bound if isinstance(bound, float) and bound > 0.0 else math.inf
        if getattr(magnitude, "template", "") == "abs({0})" and squared < math.inf:
            return [(magnitude.arguments[0], squared)]
    return None


@dataclass
class Loop:
    """A loop with the variables that change in it."""

    variables: list[Symbol]
    starts: list[Any]
    inner: Block
    ends: list[Any] = field(default_factory=list)
    condition: Any = None
    """Made of the first :attr:`Block.split` items of ``inner``."""
    index: Symbol | None = None
    count: int = 0

    @property
    def wanted(self) -> list[Symbol]:
        """What is computed inside for the next round, or to end."""
        return symbols_in((*self.ends, self.condition))


class Block:
    """Operations and loops in the order in which they were noted."""

    def __init__(self, parent: Block | None) -> None:
        self.parent = parent
        self.items: list[Symbol | Loop] = []
        self.known: dict[Any, Symbol] = {}
        self.split = 0

    def find(self, key: Any) -> Symbol | None:
        """The symbol of an equal operation, here or further out."""
        block: Block | None = self
        while block is not None:
            if key in block.known:
                return block.known[key]
            block = block.parent
        return None

    def again(self, symbol: Symbol, others: Mapping[int, Symbol]) -> Symbol | None:
        """The symbol of the same operation on other operands, by identity, if it was noted."""
        operands = [others.get(id(a), a) for a in symbol.arguments]
        return self.find((symbol.template, *map(identity, operands)))

    def add(self, key: Any, symbol: Symbol) -> Symbol:
        """Note an operation that is found by ``key``."""
        self.known[key] = symbol
        self.items.append(symbol)
        return symbol


class Trace:
    """The operations of one function."""

    def __init__(self, dialect: Dialect) -> None:
        self.dialect = dialect
        self.block = Block(None)
        self.functions: dict[str, Callable[..., Any]] = {}
        """What is called as it stands, by the name that it is called by."""
        self.held: dict[str, Any] = {}
        """Arrays of constants, by the name that they are written by."""
        self._held_by: dict[str, str] = {}
        self._names = 0

    def new_name(self) -> str:
        """A name that is not taken."""
        self._names += 1
        return f"x{self._names}"

    def variable(self, boolean: bool = False) -> Symbol:
        """A symbol with a name of its own."""
        return Symbol(self, "", boolean=boolean, name=self.new_name())

    def note(self, template: str, *arguments: Any, boolean: bool = False) -> Any:
        """The symbol of an operation; the one at hand where an equal one was noted."""
        arguments = tuple(plain(argument) for argument in arguments)
        known = _fold(template, arguments) if self.dialect.finite else None
        if known is not None:
            return known
        key = (template, *map(identity, arguments))
        symbol = self.block.find(key)
        if symbol is None:
            symbol = self.block.add(key, Symbol(self, template, arguments, boolean))
        return symbol

    def expect(self, condition: Any) -> bool:
        """True; the function that is written refuses to go on unless ``condition`` holds."""
        if not isinstance(condition, Symbol):
            return bool(condition)
        key = ("expected", id(condition))
        if self.block.find(key) is None:
            template, operands = self.dialect.template("expect"), [condition]
            bounds = sums_of_squares(condition) if self.dialect.finite else None
            if bounds is not None:
                template = self.dialect.expected_after([limit for _, limit in bounds])
                operands += [symbol for symbol, _ in bounds]
            self.block.add(key, Symbol(self, template, tuple(operands), statement=True))
        return True

    def assume_false(self, condition: Any) -> Any:
        """``condition``, marked for :meth:`both`."""
        if not self.dialect.finite or not isinstance(condition, Symbol):
            return condition
        return self.note(_RARE, condition, boolean=True)

    def hold(self, numbers: float | list[float]) -> str:
        """The name of constants that are made an array once, which operations take sooner."""
        key = repr(numbers)
        if key not in self._held_by:
            self._held_by[key] = name = f"k{len(self.held)}"
            self.held[name] = np.array(numbers)
        return self._held_by[key]

    def call(self, function: Callable[..., Any], arguments: Sequence[Any]) -> Symbol:
        """The symbol of a call that is made as it stands, every time."""
        name = f"f{len(self.functions)}"
        self.functions[name] = function
        symbol = Symbol(self, call_template(name, len(arguments)), tuple(map(plain, arguments)))
        symbol.raising = True
        self.block.items.append(symbol)
        return symbol

    def both(self, a: Any, b: Any, *, absorbing: bool) -> Any:
        """``a or b`` of two truth values where True is ``absorbing``, else ``a and b``."""
        for known, other in ((a, b), (b, a)):
            if isinstance(known, bool):
                return known if known is absorbing else other
        if not (a.boolean and b.boolean):
            raise NotTraceable("bitwise operations on numbers are not traced")
        if a.template == _RARE and not absorbing:
            template = self.dialect.template("and false", 2)
            return self.note(template, *a.arguments, b, boolean=True)
        template = self.dialect.template("or" if absorbing else "and", 2)
        return self.note(template, a, b, boolean=True)

    def loop(
        self,
        carry: Carry,
        body: Callable[[Any, Carry], Carry],
        condition: Callable[[Carry], Any] | None,
        count: int,
    ) -> Carry:
        """Note a loop; what does not change in it is no variable of it."""
        starts = leaves_of(carry)
        changing = [False] * len(starts)
        while True:
            outer, self.block = self.block, Block(self.block)
            try:
                held = [
                    self.variable(is_boolean(start)) if changes else start
                    for start, changes in zip(starts, changing, strict=True)
                ]
                index = self.variable() if condition is None else None
                goes_on = None if condition is None else condition(rebuild(carry, held))
                self.block.split = len(self.block.items)
                ends = leaves_of(body(index, rebuild(carry, held)))
            finally:
                inner, self.block = self.block, outer
            now = [
                changes or not same(end, start)
                for changes, end, start in zip(changing, ends, starts, strict=True)
            ]
            if now == changing:
                break
            changing = now
        if isinstance(goes_on, bool) and not goes_on:
            return carry
        variables, before, after = (list(compress(x, changing)) for x in (held, starts, ends))
        self.block.items.append(Loop(variables, before, inner, after, goes_on, index, count))
        return rebuild(carry, held)  # type: ignore[no-any-return]


_RARE = "({0})"
"""A condition that holds in few lanes, if in any."""


_NEUTRAL = {
    "{0} + {1}": (0.0, 0.0),
    "{0} - {1}": (None, 0.0),
    "{0} * {1}": (1.0, 1.0),
    "{0} / {1}": (None, 1.0),
}
"""Numbers that change nothing, by their place in an operation."""


_ABSORBING = {"{0} * {1}": (0.0, 0.0), "{0} / {1}": (0.0, None)}
"""Numbers that leave nothing."""


def _fold(template: str, arguments: tuple[Any, ...]) -> Any:
    """What an operation with 0.0 or 1.0 on finite numbers comes to, or None if it must be done."""
    if template not in _NEUTRAL:
        return None
    for place, number in enumerate(arguments):
        other = arguments[1 - place]
        if type(number) is not float or is_boolean(other):
            continue
        if number == _ABSORBING.get(template, (None, None))[place]:
            return 0.0
        if number == _NEUTRAL[template][place]:
            return other
    return None


def _unary(name: str, boolean: bool = False) -> Callable[[Any, Any], Any]:
    """A function of one number, as the dialect writes it; of a known one in the scalar world."""

    def call(self: SymbolicOps, x: Any, /) -> Any:
        if not isinstance(x, Symbol):
            return getattr(SCALAR, name)(x)
        if not boolean:
            check_numbers(x)
        return self._trace.note(self._trace.dialect.template(name), x, boolean=boolean)

    return call


class SymbolicOps:
    """The arithmetic of symbols; see :class:`integ_gym.envs.ops.ops.Ops`."""

    epsilon = SCALAR.epsilon

    def __init__(self, trace: Trace) -> None:
        self._trace = trace

    sin, cos, sqrt, tanh = _unary("sin"), _unary("cos"), _unary("sqrt"), _unary("tanh")
    floor = _unary("floor")
    isfinite, any = _unary("isfinite", boolean=True), _unary("any", boolean=True)

    def assume_true(self, condition: Any, /) -> Any:
        return self._trace.expect(condition)

    def assume_false(self, condition: Any, /) -> Any:
        return self._trace.assume_false(condition)

    def where(self, condition: Any, a: Any, b: Any, /) -> Any:
        if isinstance(condition, bool):
            return a if condition else b
        if same(a, b):
            return a
        boolean = is_boolean(a) and is_boolean(b)
        template = self._trace.dialect.template("where", 3)
        return self._trace.note(template, condition, a, b, boolean=boolean)

    def minimum(self, a: Any, b: Any, /) -> Any:
        return self._extreme("minimum", a, b)

    def maximum(self, a: Any, b: Any, /) -> Any:
        return self._extreme("maximum", a, b)

    def while_loop(
        self, condition: Callable[[Carry], Any], body: Callable[[Carry], Carry], carry: Carry
    ) -> Carry:
        return self._trace.loop(carry, lambda _, held: body(held), condition, 0)

    def repeat(self, count: int, body: Callable[[Any, Carry], Carry], carry: Carry) -> Carry:
        if count == 1:
            return body(0, carry)
        return self._trace.loop(carry, body, None, count)

    def foreign(
        self, function: Callable[..., Any], arguments: tuple[Any, ...], truths: tuple[bool, ...]
    ) -> tuple[Any, ...]:
        """One call that is made as it stands, and its results; of floats only."""
        if self._trace.dialect.lanes:
            raise NotTraceable("a call of floats is not traced for arrays")
        called = self._trace.call(function, arguments)
        return tuple(
            self._trace.note(f"{{0}}[{k}]", called, boolean=truth) for k, truth in enumerate(truths)
        )

    def _extreme(self, name: str, a: Any, b: Any) -> Any:
        if not isinstance(a, Symbol) and not isinstance(b, Symbol):
            return getattr(SCALAR, name)(a, b)
        if same(a, b):
            return a
        template = self._trace.dialect.template(name, 2)
        if not isinstance(a, Symbol) and a == a:
            template = template.replace(" or {0} != {0}", "")
        return self._trace.note(template, a, b, boolean=is_boolean(a) and is_boolean(b))
