"""Symbols, the operations on them, and the blocks and loops in which they are noted."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from integ_gym.envs.ops import Carry
from integ_gym.envs.tracing.dialects import Dialect
from integ_gym.envs.tracing.trees import leaves_of, rebuilt


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
        return self.find((symbol.template, *(_identity(operand) for operand in operands)))


class Trace:
    """The operations of one function."""

    def __init__(self, dialect: Dialect) -> None:
        self.dialect = dialect
        self.block = Block(None)
        self.functions: dict[str, Callable[..., Any]] = {}
        """What is called as it stands, by the name that it is called by."""
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
        if self.dialect.folds:
            known = folded(template, arguments)
            if known is not None:
                return known
        key = (template, *(_identity(argument) for argument in arguments))
        symbol = self.block.find(key)
        if symbol is None:
            symbol = Symbol(self, template, arguments, boolean)
            self.block.known[key] = symbol
            self.block.items.append(symbol)
        return symbol

    def expect(self, condition: Any) -> bool:
        """True; the function that is written refuses to go on unless ``condition`` holds."""
        if isinstance(condition, Symbol) and self.block.find(("expected", id(condition))) is None:
            template = self.dialect.expectation
            symbol = Symbol(self, template, (condition,), statement=True)
            self.block.known["expected", id(condition)] = symbol
            self.block.items.append(symbol)
        return isinstance(condition, Symbol) or bool(condition)

    def call(self, function: Callable[..., Any], arguments: Sequence[Any]) -> Symbol:
        """The symbol of a call that is made as it stands, every time."""
        name = f"f{len(self.functions)}"
        self.functions[name] = function
        places = ", ".join(f"{{{k}}}" for k in range(len(arguments)))
        symbol = Symbol(self, f"{name}({places})", tuple(map(plain, arguments)))
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
        template = self.dialect.disjunction if absorbing else self.dialect.conjunction
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
                goes_on = None if condition is None else condition(rebuilt(carry, held))
                self.block.split = len(self.block.items)
                ends = leaves_of(body(index, rebuilt(carry, held)))
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
        kept = [i for i, changes in enumerate(changing) if changes]
        self.block.items.append(
            Loop(
                [held[i] for i in kept], [starts[i] for i in kept], inner,
                [ends[i] for i in kept], goes_on, index, count,
            )
        )  # fmt: skip
        return rebuilt(carry, held)  # type: ignore[no-any-return]


_NEUTRAL = {
    "{0} + {1}": (0.0, 0.0),
    "{0} - {1}": (None, 0.0),
    "{0} * {1}": (1.0, 1.0),
    "{0} / {1}": (None, 1.0),
}
"""Numbers that change nothing, by their place in an operation."""

_ABSORBING = {"{0} * {1}": (0.0, 0.0), "{0} / {1}": (0.0, None)}
"""Numbers that leave nothing."""


def folded(template: str, arguments: tuple[Any, ...]) -> Any:
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


def _identity(value: Any) -> Any:
    """What tells two operands apart: equal numbers of one type and sign are one."""
    if isinstance(value, Symbol):
        return id(value)
    return type(value), repr(value)


def same(a: Any, b: Any) -> bool:
    return a is b or bool(_identity(a) == _identity(b))


def is_boolean(value: Any) -> bool:
    return value.boolean if isinstance(value, Symbol) else isinstance(value, bool)


def symbols_in(value: Any) -> list[Symbol]:
    """Symbols in a result, as often as they stand there."""
    if isinstance(value, dict):
        return [symbol for part in value.values() for symbol in symbols_in(part)]
    if isinstance(value, tuple):
        return [symbol for part in value for symbol in symbols_in(part)]
    return [value] if isinstance(value, Symbol) else []
