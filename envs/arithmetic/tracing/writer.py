"""Source of a trace."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from itertools import chain
from typing import Any, Final

from .liveness import live_items, needed
from .symbols import Symbol, plain, symbols_in
from .syntax import Syntax
from .trace import Block, Loop, Trace

_DEEPEST: Final = 12
"""Expressions nested deeper than this are given a name."""

_OF_PYTHON_NUMBERS: Final = ("{0} ** {1}",)
"""Operations that NumPy does otherwise where a constant is an array."""

_WHERE: Final = "where({0}, {1}, {2})"


class Writer:
    """Writes blocks down, leaving out what nobody uses and naming what is used twice."""

    def __init__(self, trace: Trace) -> None:
        self._trace = trace
        self._syntax = trace.dialect.syntax
        self._shared: set[int] = set()
        self._cut = 0
        """Lines of the block written last that belong to its first :attr:`Block.split` items."""

    def block(self, block: Block, wanted: Sequence[Symbol]) -> list[str]:
        """The statements that compute the ``wanted`` symbols."""
        live = live_items(block, wanted)
        for symbol in (*wanted, *chain.from_iterable(map(needed, live))):
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
        symbol.depth = 1 + max((a.depth for a in symbol.arguments if _inlined(a)), default=0)
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
            inside += syntax.assigned(names, ends)
            return [*head, *syntax.counting(loop.index.name, loop.count, inside)]
        condition = self._operand(loop.condition, bare=True)
        if self._trace.dialect.lanes:
            active = self._trace.new_name()
            leave = [syntax.named(active, condition), syntax.leave_unless(f"any_lane({active})")]
            kept = [f"where({active}, {e}, {n})" for n, e in zip(names, ends, strict=True)]
            assigned = [syntax.assigned(names, values) for values in (ends, kept)]
            ending = syntax.either(f"all_lanes({active})", *assigned)
        else:
            leave = [syntax.leave_unless(condition)]
            ending = syntax.assigned(names, ends)
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


def _inlined(value: Any) -> bool:
    return isinstance(value, Symbol) and not value.name


def target(syntax: Syntax, value: Any) -> str:
    """Left side of the assignment that takes an argument apart."""
    if isinstance(value, tuple):
        return syntax.together([target(syntax, part) for part in value])
    return str(value.name)
