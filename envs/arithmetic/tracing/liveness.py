"""What of a trace is needed, and what can be left out."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import compress
from typing import Any

from ..trees import leaves_of
from .symbols import Symbol, symbols_in
from .trace import Block, Loop


def needed(item: Symbol | Loop) -> list[Symbol]:
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
            if _raising_within(item.inner) or _trim(item, live):
                kept.append(item)
                live |= {id(symbol) for symbol in needed(item)} | _reach_inside(item, {}).keys()
        elif item.raising or id(item) in live:
            kept.append(item)
            live |= {id(symbol) for symbol in needed(item)}
    return kept[::-1]


def carried(block: Block, state: Any, result: Any) -> dict[int, Symbol]:
    """Operations on a state that are done on the next state as well.

    Args:
        block: the outermost one.
        state: the symbols of the state that a function is given.
        result: what it returns; first the next state, shaped alike.

    Returns:
        By identity of an operation on the state that others need: the same on the next state.
    """
    live = _reach(block, [*symbols_in(result), *_raising_within(block)], {})
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
    return _reach(loop.inner, [*loop.wanted, *_raising_within(loop.inner)], found)


def _raising_within(block: Block) -> list[Symbol]:
    """Operations in a block, and in its loops, that can raise."""
    found: list[Symbol] = []
    for item in block.items:
        if isinstance(item, Loop):
            found += _raising_within(item.inner)
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
            waiting += needed(loops[id(symbol)])
            _reach_inside(loops[id(symbol)], found)
    return found
