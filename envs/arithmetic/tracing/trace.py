"""What a function does to symbols: operations and loops, in blocks."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import compress
from typing import Any

import numpy as np

from ..ops import Carry
from ..trees import leaves_of, rebuilt
from .bounds import sums_of_squares
from .dialects import Dialect, called
from .symbols import NotTraceable, Symbol, identity, is_boolean, plain, same, symbols_in


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
        known = _folded(template, arguments) if self.dialect.finite else None
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

    def rarely(self, condition: Any) -> Any:
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
        symbol = Symbol(self, called(name, len(arguments)), tuple(map(plain, arguments)))
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
            template = self.dialect.template("and rarely", 2)
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
        variables, before, after = (list(compress(x, changing)) for x in (held, starts, ends))
        self.block.items.append(Loop(variables, before, inner, after, goes_on, index, count))
        return rebuilt(carry, held)  # type: ignore[no-any-return]


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


def _folded(template: str, arguments: tuple[Any, ...]) -> Any:
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
