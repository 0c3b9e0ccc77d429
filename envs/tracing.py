"""Python source of functions over components: run once on symbols, written down, compiled.

A function written for :class:`integ_gym.envs.ops.Ops` is called with symbols in place of floats.
Every operation is noted, equal ones once; what remains is a function of floats without calls,
tuples and attribute look-ups in between, whose operations are those of the scalar world.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from integ_gym.envs.ops import SCALAR, Carry

_DEEPEST: Final = 12
"""Expressions nested deeper than this are given a name."""

_GLOBALS: Final[Mapping[str, Any]] = {
    "sin": math.sin,
    "cos": math.cos,
    "sqrt": math.sqrt,
    "tanh": math.tanh,
    "isfinite": math.isfinite,
    "inf": math.inf,
    "nan": math.nan,
}


class NotTraceable(TypeError):
    """A function that needs to know the value of a component while it is traced."""


class Symbol:
    """A float, integer or truth value that is known when the traced function runs."""

    __slots__ = (
        "arguments", "block", "boolean", "depth", "name", "raising", "template", "trace", "uses",
    )  # fmt: skip

    def __init__(
        self,
        trace: Trace,
        template: str,
        arguments: tuple[Any, ...] = (),
        boolean: bool = False,
        name: str = "",
    ) -> None:
        self.trace = trace
        self.block = trace.block
        self.template = template
        self.arguments = arguments
        self.boolean = boolean
        self.name = name
        self.raising = _can_raise(template, arguments)
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
            return self.trace.note("not {0}", self, boolean=True)
        return self.trace.note("{0} == {1}", self, other, boolean=True)

    def __ne__(self, other: Any) -> Any:
        return self.trace.note("{0} != {1}", self, other, boolean=True)

    def __and__(self, other: Any) -> Any:
        return self.trace.both("and", self, other, absorbing=False)

    def __rand__(self, other: Any) -> Any:
        return self.trace.both("and", self, other, absorbing=False)

    def __or__(self, other: Any) -> Any:
        return self.trace.both("or", self, other, absorbing=True)

    def __ror__(self, other: Any) -> Any:
        return self.trace.both("or", self, other, absorbing=True)


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


class Trace:
    """The operations of one function."""

    def __init__(self) -> None:
        self.block = Block(None)
        self.functions: dict[str, Callable[..., Any]] = {}
        self._names = 0

    def new_name(self) -> str:
        """A name that is not taken."""
        self._names += 1
        return f"x{self._names}"

    def variable(self, boolean: bool = False) -> Symbol:
        """A symbol with a name of its own."""
        return Symbol(self, "", boolean=boolean, name=self.new_name())

    def note(self, template: str, *arguments: Any, boolean: bool = False) -> Symbol:
        """The symbol of an operation; the one at hand where an equal one was noted."""
        arguments = tuple(_plain(argument) for argument in arguments)
        key = (template, *(_identity(argument) for argument in arguments))
        symbol = self.block.find(key)
        if symbol is None:
            symbol = Symbol(self, template, arguments, boolean)
            self.block.known[key] = symbol
            self.block.items.append(symbol)
        return symbol

    def call(self, function: Callable[..., Any], arguments: Sequence[Any]) -> Symbol:
        """The symbol of a call that is made as it stands, every time."""
        name = f"f{len(self.functions)}"
        self.functions[name] = function
        places = ", ".join(f"{{{k}}}" for k in range(len(arguments)))
        symbol = Symbol(self, f"{name}({places})", tuple(arguments))
        symbol.raising = True
        self.block.items.append(symbol)
        return symbol

    def both(self, word: str, a: Any, b: Any, *, absorbing: bool) -> Any:
        """``a and b`` or ``a or b`` of two truth values."""
        for known, other in ((a, b), (b, a)):
            if isinstance(known, bool):
                return known if known is absorbing else other
        if not (a.boolean and b.boolean):
            raise NotTraceable("bitwise operations on numbers are not traced")
        return self.note(f"{{0}} {word} {{1}}", a, b, boolean=True)

    def loop(
        self,
        carry: Carry,
        body: Callable[[Any, Carry], Carry],
        condition: Callable[[Carry], Any] | None,
        count: int,
    ) -> Carry:
        """Note a loop; what does not change in it is no variable of it."""
        starts = _leaves(carry)
        changing = [False] * len(starts)
        while True:
            outer, self.block = self.block, Block(self.block)
            try:
                held = [
                    self.variable(_is_boolean(start)) if changes else start
                    for start, changes in zip(starts, changing, strict=True)
                ]
                index = self.variable() if condition is None else None
                goes_on = None if condition is None else condition(_rebuilt(carry, held))
                self.block.split = len(self.block.items)
                ends = _leaves(body(index, _rebuilt(carry, held)))
            finally:
                inner, self.block = self.block, outer
            now = [
                changes or not _same(end, start)
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
        return _rebuilt(carry, held)  # type: ignore[no-any-return]


class SymbolicOps:
    """The arithmetic of symbols; see :class:`integ_gym.envs.ops.Ops`."""

    epsilon = SCALAR.epsilon

    def __init__(self, trace: Trace) -> None:
        self._trace = trace

    def sin(self, x: Any, /) -> Any:
        return self._call("sin", x)

    def cos(self, x: Any, /) -> Any:
        return self._call("cos", x)

    def sqrt(self, x: Any, /) -> Any:
        return self._call("sqrt", x)

    def tanh(self, x: Any, /) -> Any:
        return self._call("tanh", x)

    def isfinite(self, x: Any, /) -> Any:
        return self._call("isfinite", x, boolean=True)

    def any(self, condition: Any, /) -> Any:
        return condition

    def where(self, condition: Any, a: Any, b: Any, /) -> Any:
        if isinstance(condition, bool):
            return a if condition else b
        if _same(a, b):
            return a
        boolean = _is_boolean(a) and _is_boolean(b)
        return self._trace.note("{1} if {0} else {2}", condition, a, b, boolean=boolean)

    def minimum(self, a: Any, b: Any, /) -> Any:
        return self._extreme("<=", a, b, SCALAR.minimum)

    def maximum(self, a: Any, b: Any, /) -> Any:
        return self._extreme(">=", a, b, SCALAR.maximum)

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
        """One call that is made as it stands, and its results."""
        called = self._trace.call(function, arguments)
        return tuple(
            self._trace.note(f"{{0}}[{k}]", called, boolean=truth) for k, truth in enumerate(truths)
        )

    def _call(self, name: str, x: Any, boolean: bool = False) -> Any:
        if isinstance(x, Symbol):
            return self._trace.note(f"{name}({{0}})", x, boolean=boolean)
        return getattr(SCALAR, name)(x)

    def _extreme(self, sign: str, a: Any, b: Any, known: Callable[[Any, Any], Any]) -> Any:
        if not isinstance(a, Symbol) and not isinstance(b, Symbol):
            return known(a, b)
        if _same(a, b):
            return a
        number = f"{{0}} {sign} {{1}}" if not isinstance(a, Symbol) and a == a else ""
        test = number or f"{{0}} {sign} {{1}} or {{0}} != {{0}}"
        return self._trace.note(f"{{0}} if {test} else {{1}}", a, b)


def compiled(function: Callable[..., Any], *patterns: Any) -> Callable[..., Any]:
    """A function of floats that does what ``function`` does in the scalar world.

    Args:
        function: takes an ``Ops`` and then arguments shaped like ``patterns``; returns tuples,
            dictionaries and components.
        patterns: tuples, nested at will, with True where a truth value stands and False where a
            number does.

    Returns:
        A function of the same arguments without the ``Ops``. Where the scalar world gives NaN for
        an argument outside a function's domain, it raises ``ValueError`` instead.

    Raises:
        NotTraceable: if ``function`` asks for the value of a component.
    """
    trace = Trace()
    arguments = [_rebuilt(p, [trace.variable(leaf) for leaf in _leaves(p)]) for p in patterns]
    result = function(SymbolicOps(trace), *arguments)
    writer = _Writer(trace)
    names = [f"a{k}" for k in range(len(arguments))]
    lines = [
        f"{_target(argument)} = {name}" for name, argument in zip(names, arguments, strict=True)
    ]
    lines += writer.block(trace.block, _symbols(result))
    lines.append(f"return {writer.display(result)}")
    source = f"def traced({', '.join(names)}):\n" + "".join(f"    {line}\n" for line in lines)
    space = {**_GLOBALS, **trace.functions}
    exec(compile(source, f"<traced {getattr(function, '__name__', '')}>", "exec"), space)
    made: Callable[..., Any] = space["traced"]
    made.__doc__ = source
    return made


class _Writer:
    """Writes blocks down, leaving out what nobody uses and naming what is used twice."""

    def __init__(self, trace: Trace) -> None:
        self._trace = trace
        self._cut = 0
        """Lines of the block written last that belong to its first :attr:`Block.split` items."""

    def block(self, block: Block, wanted: Sequence[Symbol]) -> list[str]:
        """The statements that compute the ``wanted`` symbols."""
        live = _live_items(block, wanted)
        for item in live:
            for symbol in _needed(item):
                symbol.uses += 1 if symbol.block is block else 2
        for symbol in wanted:
            symbol.uses += 1 if symbol.block is block else 2
        lines: list[str] = []
        self._cut = 0
        first = {id(item) for item in block.items[: block.split]}
        cut = 0
        for item in live:
            lines += self._loop(item) if isinstance(item, Loop) else self._operation(item)
            cut = len(lines) if id(item) in first else cut
        self._cut = cut
        return lines

    def display(self, value: Any) -> str:
        """Source of a result: tuples, dictionaries, symbols and constants."""
        if isinstance(value, dict):
            return "{" + ", ".join(f"{k!r}: {self.display(v)}" for k, v in value.items()) + "}"
        if isinstance(value, tuple):
            return "(" + "".join(f"{self.display(v)}, " for v in value) + ")"
        return self._operand(value, bare=True)

    def _operation(self, symbol: Symbol) -> list[str]:
        symbol.depth = 1 + max((a.depth for a in symbol.arguments if _inlined(a)), default=0)
        if symbol.uses == 1 and symbol.depth <= _DEEPEST and not symbol.raising:
            return []
        expression = self._expression(symbol)
        symbol.name = self._trace.new_name()
        return [f"{symbol.name} = {expression}"]

    def _loop(self, loop: Loop) -> list[str]:
        head = [
            f"{variable.name} = {self._operand(start, bare=True)}"
            for variable, start in zip(loop.variables, loop.starts, strict=True)
        ]
        wanted = [s for s in (*loop.ends, loop.condition) if isinstance(s, Symbol)]
        inside = self.block(loop.inner, wanted)
        if loop.condition is not None:
            cut = self._cut
            stop = f"if not ({self._operand(loop.condition, bare=True)}): break"
            inside = [*inside[:cut], stop, *inside[cut:]]
        targets = ", ".join(variable.name for variable in loop.variables)
        values = ", ".join(self._operand(end, bare=True) for end in loop.ends)
        if loop.variables:
            inside.append(f"{targets} = {values}")
        opening = "while True:"
        if loop.index is not None:
            opening = f"for {loop.index.name} in range({loop.count}):"
        return [*head, opening, *(f"    {line}" for line in inside or ["pass"])]

    def _expression(self, symbol: Symbol) -> str:
        return symbol.template.format(*(self._operand(a) for a in symbol.arguments))

    def _operand(self, value: Any, bare: bool = False) -> str:
        if not isinstance(value, Symbol):
            text = repr(_plain(value))
            return f"({text})" if text.startswith("-") else text
        if value.name:
            return value.name
        expression = self._expression(value)
        return expression if bare else f"({expression})"


def _inlined(value: Any) -> bool:
    return isinstance(value, Symbol) and not value.name


def _needed(item: Symbol | Loop) -> list[Symbol]:
    """Symbols whose source an operation, or what surrounds a loop, holds."""
    if isinstance(item, Loop):
        return [start for start in item.starts if isinstance(start, Symbol)]
    repeated = [
        argument
        for place, argument in enumerate(item.arguments)
        for _ in range(item.template.count(f"{{{place}}}"))
    ]
    return [argument for argument in repeated if isinstance(argument, Symbol)]


def _live_items(block: Block, wanted: Sequence[Symbol]) -> list[Symbol | Loop]:
    """Items of a block that the wanted symbols need, loops cut down to the variables needed.

    What can raise is kept in any case, and given a name: the scalar world evaluates everything.
    """
    live: set[int] = {id(symbol) for symbol in wanted}
    kept: list[Symbol | Loop] = []
    for item in reversed(block.items):
        if isinstance(item, Loop):
            if _raising_within(item.inner) or _trim(item, live):
                kept.append(item)
                live |= {id(s) for s in (*_needed(item), *_outer_needs(item))}
        elif item.raising or id(item) in live:
            kept.append(item)
            live |= {id(symbol) for symbol in _needed(item)}
    return kept[::-1]


def _trim(loop: Loop, live: set[int]) -> bool:
    """Leave out the variables that neither the rest nor the loop itself needs."""
    needed = {id(v) for v in loop.variables if id(v) in live}
    if not needed:
        return False
    while True:
        ends = [e for v, e in zip(loop.variables, loop.ends, strict=True) if id(v) in needed]
        inside = _reached(loop.inner, [*ends, loop.condition])
        more = needed | {id(v) for v in loop.variables if id(v) in inside}
        if more == needed:
            break
        needed = more
    keep = [k for k, variable in enumerate(loop.variables) if id(variable) in needed]
    loop.variables = [loop.variables[k] for k in keep]
    loop.starts = [loop.starts[k] for k in keep]
    loop.ends = [loop.ends[k] for k in keep]
    return True


def _outer_needs(loop: Loop) -> list[Symbol]:
    """Symbols from outside that the inside of a loop uses."""
    wanted = [s for s in (*loop.ends, loop.condition) if isinstance(s, Symbol)]
    found: dict[int, Symbol] = {}
    _reach(loop.inner, [*wanted, *_raising_within(loop.inner)], found)
    return list(found.values())


def _raising_within(block: Block) -> list[Symbol]:
    """Operations in a block, and in its loops, that can raise."""
    found: list[Symbol] = []
    for item in block.items:
        if isinstance(item, Loop):
            found += _raising_within(item.inner)
        elif item.raising:
            found.append(item)
    return found


def _can_raise(template: str, arguments: tuple[Any, ...]) -> bool:
    """Whether an operation can raise an ``ArithmeticError`` in the scalar world."""
    if template == "{0} ** {1}":
        return True
    if template not in ("{0} / {1}", "{0} % {1}"):
        return False
    return isinstance(arguments[1], Symbol) or arguments[1] == 0


def _plain(value: Any) -> Any:
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


def _reached(block: Block, wanted: Sequence[Any]) -> set[int]:
    found: dict[int, Symbol] = {}
    _reach(block, [s for s in wanted if isinstance(s, Symbol)], found)
    return set(found)


def _reach(block: Block, wanted: Sequence[Symbol], found: dict[int, Symbol]) -> None:
    """Collect everything that the wanted symbols are made of."""
    loops = {
        id(variable): item
        for item in block.items
        if isinstance(item, Loop)
        for variable in item.variables
    }
    waiting = list(wanted)
    while waiting:
        symbol = waiting.pop()
        if id(symbol) in found:
            continue
        found[id(symbol)] = symbol
        waiting += [argument for argument in symbol.arguments if isinstance(argument, Symbol)]
        if id(symbol) in loops:
            loop = loops[id(symbol)]
            waiting += [s for s in loop.starts if isinstance(s, Symbol)]
            inner = [s for s in (*loop.ends, loop.condition) if isinstance(s, Symbol)]
            _reach(loop.inner, [*inner, *_raising_within(loop.inner)], found)


def _identity(value: Any) -> Any:
    """What tells two operands apart: equal numbers of one type and sign are one."""
    if isinstance(value, Symbol):
        return id(value)
    return type(value), repr(value)


def _same(a: Any, b: Any) -> bool:
    return a is b or bool(_identity(a) == _identity(b))


def _is_boolean(value: Any) -> bool:
    return value.boolean if isinstance(value, Symbol) else isinstance(value, bool)


def _leaves(value: Any) -> list[Any]:
    """Components of a nested tuple, in order."""
    if isinstance(value, tuple):
        return [leaf for part in value for leaf in _leaves(part)]
    return [value]


def _rebuilt(pattern: Any, leaves: Sequence[Any]) -> Any:
    """A nested tuple like ``pattern`` with other components."""
    rest = iter(leaves)

    def build(part: Any) -> Any:
        if not isinstance(part, tuple):
            return next(rest)
        parts = [build(inner) for inner in part]
        return type(part)(*parts) if hasattr(part, "_fields") else tuple(parts)

    return build(pattern)


def _symbols(value: Any) -> list[Symbol]:
    """Symbols in a result, as often as they stand there."""
    if isinstance(value, dict):
        return [symbol for part in value.values() for symbol in _symbols(part)]
    if isinstance(value, tuple):
        return [symbol for part in value for symbol in _symbols(part)]
    return [value] if isinstance(value, Symbol) else []


def _target(value: Any) -> str:
    """Left side of the assignment that takes an argument apart."""
    if isinstance(value, tuple):
        return "(" + "".join(f"{_target(part)}, " for part in value) + ")"
    return str(value.name)
