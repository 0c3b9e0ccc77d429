"""Source of a trace."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from itertools import chain
from typing import Any, Final

from .liveness import live_items, needed
from .symbols import Symbol, plain, symbols_in
from .trace import Block, Loop, Trace

_DEEPEST: Final = 12
"""Expressions nested deeper than this are given a name."""


class Writer:
    """Writes blocks down, leaving out what nobody uses and naming what is used twice."""

    def __init__(self, trace: Trace) -> None:
        self._trace = trace
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
            return "{" + ", ".join(f"{k!r}: {self._entry(v)}" for k, v in value.items()) + "}"
        if isinstance(value, tuple):
            return "(" + "".join(f"{self._display(v)}, " for v in value) + ")"
        return self._operand(value, bare=True)

    def _entry(self, value: Any) -> str:
        text = self._display(value)
        shared = isinstance(value, Symbol) and (id(value) in self._shared or not value.template)
        return self._trace.dialect.template("own").format(text) if shared else text

    def _operation(self, symbol: Symbol) -> list[str]:
        symbol.depth = 1 + max((a.depth for a in symbol.arguments if _inlined(a)), default=0)
        if symbol.uses == 1 and symbol.depth <= _DEEPEST and not symbol.raising:
            return []
        expression = self._expression(symbol)
        if symbol.statement:
            return [expression]
        symbol.name = self._trace.new_name()
        return [f"{symbol.name} = {expression}"]

    def _loop(self, loop: Loop) -> list[str]:
        head = [
            f"{variable.name} = {self._operand(start, bare=True)}"
            for variable, start in zip(loop.variables, loop.starts, strict=True)
        ]
        inside = self.block(loop.inner, loop.wanted)
        names = [variable.name for variable in loop.variables]
        ends = [self._operand(end, bare=True) for end in loop.ends]
        if loop.index is not None:
            opening = f"for {loop.index.name} in range({loop.count}):"
            inside += _assigned(names, ends)
        elif self._trace.dialect.lanes:
            opening, active = "while True:", self._trace.new_name()
            inside[self._cut : self._cut] = [
                f"{active} = {self._operand(loop.condition, bare=True)}",
                f"if not any_lane({active}): break",
            ]
            kept = [f"where({active}, {e}, {n})" for n, e in zip(names, ends, strict=True)]
            inside += [f"if not all_lanes({active}):", *_indented(_assigned(names, kept))]
            inside += ["else:", *_indented(_assigned(names, ends))]
        else:
            opening = "while True:"
            stop = f"if not ({self._operand(loop.condition, bare=True)}): break"
            inside.insert(self._cut, stop)
            inside += _assigned(names, ends)
        return [*head, opening, *_indented(inside or ["pass"])]

    def _expression(self, symbol: Symbol) -> str:
        return symbol.template.format(*(self._operand(a) for a in symbol.arguments))

    def _operand(self, value: Any, bare: bool = False) -> str:
        if not isinstance(value, Symbol):
            text = repr(plain(value))
            return f"({text})" if text.startswith("-") else text
        if value.name:
            return value.name
        expression = self._expression(value)
        return expression if bare else f"({expression})"


def _assigned(names: Sequence[str], values: Sequence[str]) -> list[str]:
    """All at once, as each value may be made of any of the names."""
    return [f"{', '.join(names)} = {', '.join(values)}"] if names else []


def _indented(lines: Sequence[str]) -> list[str]:
    return [f"    {line}" for line in lines]


def _inlined(value: Any) -> bool:
    return isinstance(value, Symbol) and not value.name


def target(value: Any) -> str:
    """Left side of the assignment that takes an argument apart."""
    if isinstance(value, tuple):
        return "(" + "".join(f"{target(part)}, " for part in value) + ")"
    return str(value.name)
