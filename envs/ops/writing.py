"""Source text of a trace, for floats, arrays and compiled loops."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from itertools import chain, compress
from typing import Any, Final

import numpy as np

from .ops import leaves_of
from .tracing import Block, Loop, Symbol, Trace, plain, symbols_in


def needed_symbols(item: Symbol | Loop) -> list[Symbol]:
    """Symbols whose source an operation, or what surrounds a loop, holds."""
    if isinstance(item, Loop):
        return symbols_in(tuple(item.starts))
    return [
        symbol
        for place, argument in enumerate(item.arguments)
        for symbol in symbols_in(argument) * item.template.count(f"{{{place}}}")
    ]


def live_items(block: Block, wanted: Sequence[Symbol]) -> list[Symbol | Loop]:
    """Items of a block that the wanted symbols need, loops cut down to the variables needed.

    What can raise is kept in any case, and given a name: the scalar world evaluates everything.
    """
    live: set[int] = {id(symbol) for symbol in wanted}
    kept: list[Symbol | Loop] = []
    for item in reversed(block.items):
        if isinstance(item, Loop):
            if _find_raising(item.inner) or _trim(item, live):
                kept.append(item)
                live |= {id(symbol) for symbol in needed_symbols(item)} | _reach_inside(
                    item, {}
                ).keys()
        elif item.raising or id(item) in live:
            kept.append(item)
            live |= {id(symbol) for symbol in needed_symbols(item)}
    return kept[::-1]


def find_carried(block: Block, state: Any, result: Any) -> dict[int, Symbol]:
    """Operations on a state that are done on the next state as well.

    Args:
        block: the outermost one.
        state: the symbols of the state that a function is given.
        result: what it returns; first the next state, shaped alike.

    Returns:
        By identity of an operation on the state that others need: the same on the next state.
    """
    live = _reach(block, [*symbols_in(result), *_find_raising(block)], {})
    pairs = zip(leaves_of(state), leaves_of(result[0]), strict=True)
    next_of = {id(old): new for old, new in pairs if isinstance(new, Symbol)}
    repeated: dict[int, Symbol] = {}
    for item in block.items:
        if isinstance(item, Loop) or item.raising or id(item) not in live:
            continue
        known = [id(symbol) in next_of for symbol in symbols_in(item.arguments)]
        same = block.again(item, next_of) if known and all(known) else None
        if same is not None and same is not item and id(same) in live:
            next_of[id(item)] = repeated[id(item)] = same
    users = [symbol for key, symbol in live.items() if key not in repeated]
    needed_by_others = {id(argument) for user in users for argument in user.arguments}
    needed_by_others |= {id(symbol) for symbol in symbols_in(result)}
    loops = [item for item in block.items if isinstance(item, Loop)]
    needed_by_others |= {id(start) for loop in loops for start in loop.starts}
    return {key: same for key, same in repeated.items() if key in needed_by_others}


def _trim(loop: Loop, live: set[int]) -> bool:
    """Leave out the variables that neither the rest nor the loop itself needs."""
    needed = {id(v) for v in loop.variables if id(v) in live}
    if not needed:
        return False
    while True:
        ends = [e for v, e in zip(loop.variables, loop.ends, strict=True) if id(v) in needed]
        inside = _reach(loop.inner, symbols_in((*ends, loop.condition)), {})
        more = needed | {id(v) for v in loop.variables if id(v) in inside}
        if more == needed:
            break
        needed = more
    keep = [id(variable) in needed for variable in loop.variables]
    columns = (loop.variables, loop.starts, loop.ends)
    loop.variables, loop.starts, loop.ends = (list(compress(x, keep)) for x in columns)
    return True


def _reach_inside(loop: Loop, found: dict[int, Symbol]) -> dict[int, Symbol]:
    """As :func:`_reach`, of all that is computed inside a loop."""
    return _reach(loop.inner, [*loop.wanted, *_find_raising(loop.inner)], found)


def _find_raising(block: Block) -> list[Symbol]:
    """Operations in a block, and in its loops, that can raise."""
    found: list[Symbol] = []
    for item in block.items:
        if isinstance(item, Loop):
            found += _find_raising(item.inner)
        elif item.raising:
            found.append(item)
    return found


def _reach(block: Block, wanted: Sequence[Symbol], found: dict[int, Symbol]) -> dict[int, Symbol]:
    """``found``, by identity, with everything added that the wanted symbols are made of."""
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
        waiting += symbols_in(symbol.arguments)
        if id(symbol) in loops:
            waiting += needed_symbols(loops[id(symbol)])
            _reach_inside(loops[id(symbol)], found)
    return found


_DEEPEST: Final = 12
"""Expressions nested deeper than this are given a name."""

_OF_PYTHON_NUMBERS: Final = ("{0} ** {1}",)
"""Operations that NumPy does otherwise where a constant is an array."""

_WHERE: Final = "where({0}, {1}, {2})"


class Writer:
    """Writes blocks down, leaving out what is not used and naming what is used twice."""

    def __init__(self, trace: Trace) -> None:
        self._trace = trace
        self._syntax = trace.dialect.syntax
        self._shared: set[int] = set()
        self._cut = 0
        """Lines of the block written last that belong to its first :attr:`Block.split` items."""

    def block(self, block: Block, wanted: Sequence[Symbol]) -> list[str]:
        """The statements that compute the ``wanted`` symbols."""
        live = live_items(block, wanted)
        for symbol in (*wanted, *chain.from_iterable(map(needed_symbols, live))):
            symbol.uses += 1 if symbol.block is block else 2
        lines: list[str] = []
        first = {id(item) for item in block.items[: block.split]}
        cut = 0
        for item in live:
            lines += self._loop(item) if isinstance(item, Loop) else self._operation(item)
            cut = len(lines) if id(item) in first else cut
        self._cut = cut
        return lines

    def result(self, value: Any) -> str:
        """Source of what is returned: tuples, dictionaries, symbols and constants.

        An entry of a dictionary that stands elsewhere, too, is copied where the dialect copies.
        """
        counts = Counter(map(id, symbols_in(value)))
        self._shared = {symbol for symbol, count in counts.items() if count > 1}
        return self._display(value)

    def _display(self, value: Any) -> str:
        if isinstance(value, dict):
            return self._syntax.entries([(k, self._entry(v)) for k, v in value.items()])
        if isinstance(value, tuple):
            return self._syntax.together([self._display(v) for v in value])
        return self._operand(value, bare=True)

    def _entry(self, value: Any) -> str:
        text = self._display(value)
        shared = isinstance(value, Symbol) and (id(value) in self._shared or not value.template)
        if not shared:
            return text
        own = "own computed" if value.template else "own"
        return self._trace.dialect.template(own).format(text)

    def _operation(self, symbol: Symbol) -> list[str]:
        symbol.depth = 1 + max((a.depth for a in symbol.arguments if _is_inlined(a)), default=0)
        if symbol.uses == 1 and symbol.depth <= _DEEPEST and not symbol.raising:
            return []
        expression = self._expression(symbol)
        if symbol.statement:
            return [expression]
        symbol.name = self._trace.new_name()
        return [self._syntax.named(symbol.name, expression)]

    def _loop(self, loop: Loop) -> list[str]:
        syntax = self._syntax
        head = [
            syntax.variable(variable.name, self._operand(start, bare=True))
            for variable, start in zip(loop.variables, loop.starts, strict=True)
        ]
        inside = self.block(loop.inner, loop.wanted)
        names = [variable.name for variable in loop.variables]
        ends = [self._operand(end, bare=True) for end in loop.ends]
        if loop.index is not None:
            inside += syntax.assign(names, ends)
            return [*head, *syntax.count_loop(loop.index.name, loop.count, inside)]
        condition = self._operand(loop.condition, bare=True)
        if self._trace.dialect.lanes:
            active = self._trace.new_name()
            leave = [syntax.named(active, condition), syntax.leave_unless(f"any_lane({active})")]
            kept = [f"where({active}, {e}, {n})" for n, e in zip(names, ends, strict=True)]
            assigned = [syntax.assign(names, values) for values in (ends, kept)]
            ending = syntax.either(f"all_lanes({active})", *assigned)
        else:
            leave = [syntax.leave_unless(condition)]
            ending = syntax.assign(names, ends)
        inside[self._cut : self._cut] = leave
        return [*head, *syntax.forever([*inside, *ending])]

    def _expression(self, symbol: Symbol) -> str:
        operands = symbol.arguments
        if not self._trace.dialect.lanes or symbol.template in _OF_PYTHON_NUMBERS:
            return symbol.template.format(*map(self._operand, operands))
        if symbol.template == _WHERE and type(operands[1]) is type(operands[2]) is float:
            choices = self._trace.hold([operands[2], operands[1]])
            return f"{choices}.take({self._operand(operands[0])})"
        return symbol.template.format(*map(self._held_operand, operands))

    def _held_operand(self, value: Any) -> str:
        return self._trace.hold(value) if type(value) in (int, float) else self._operand(value)

    def _operand(self, value: Any, bare: bool = False) -> str:
        if not isinstance(value, Symbol):
            text = self._syntax.constant(plain(value))
            return f"({text})" if text.startswith("-") else text
        if value.name:
            return value.name
        expression = self._expression(value)
        return expression if bare else f"({expression})"


def _is_inlined(value: Any) -> bool:
    return isinstance(value, Symbol) and not value.name


def execute(source: str, names: dict[str, Any]) -> Callable[..., Any]:
    """The function ``traced`` of a source, which is its docstring.

    Args:
        source: of the function.
        names: what it refers to.
    """
    exec(compile(source, "<traced>", "exec"), names)
    made: Callable[..., Any] = names["traced"]
    made.__doc__ = source
    return made


def in_lanes(value: Any, like: Any) -> Any:
    """An array as it is; a number as one entry per lane of ``like``."""
    return value if isinstance(value, np.ndarray) else np.full(like.shape, value)
