"""Loops over lanes, in source."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ...trees import leaves_of
from ..symbols import Symbol, symbols_in
from ..syntax import PYTHON_SYNTAX
from ..trace import Block, Trace
from ..writer import Writer
from .results import Put
from .stages import Item, made_in, operands, stages


def written(
    trace: Trace, arguments: Sequence[Any], puts: Sequence[Put]
) -> tuple[list[Symbol], list[str]]:
    """One loop per stage.

    Args:
        trace: in the dialect of one lane.
        arguments: symbols that are given, each as an array called ``of_`` and its name.
        puts: what lanes put where.

    Returns:
        What of the arguments is read, and statements. Whether all was as expected is ``usual``.
    """
    parted = stages(trace.block, _values(puts))
    made = {id(x): place for place, items in enumerate(parted) for x in made_in(items)}
    puts_of: list[list[Put]] = [[] for _ in parted]
    for put in puts:
        puts_of[made.get(id(put.value), -1)].append(put)
    needs = [
        {id(x): x for x in (*_operands(items), *_values(own))}
        for items, own in zip(parted, puts_of, strict=True)
    ]
    given = leaves_of(tuple(arguments))
    found = {id(x): f"of_{x.name}[lane]" for x in given}
    found |= {id(put.value): put.where for put in puts if put.exact and id(put.value) in made}
    writer = Writer(trace)
    lines = ["usual = True"]
    for place, items in enumerate(parted):
        before = [x for key, x in needs[place].items() if made.get(key, -1) < place]
        kept = [x for x in made_in(items) if any(id(x) in later for later in needs[place + 1 :])]
        body = writer.block(_block_of(items), [*kept, *_values(puts_of[place])])
        stores = [f"{put.where} = {writer.result(put.value)}" for put in puts_of[place]]
        for x in kept:
            if id(x) not in found:
                lines.append(f"of_{x.name} = empty(n, {'bool_' if x.boolean else 'float64'})")
                stores.append(f"of_{x.name}[lane] = {x.name}")
                found[id(x)] = f"of_{x.name}[lane]"
        reads = [f"{x.name} = {found[id(x)]}" for x in before if id(x) in found]
        lines += PYTHON_SYNTAX.counting("lane", "n", [*reads, *body, *stores])
    return [x for x in given if any(id(x) in need for need in needs)], lines


def _values(puts: Sequence[Put]) -> list[Symbol]:
    return symbols_in(tuple(put.value for put in puts))


def _operands(items: Sequence[Item]) -> list[Symbol]:
    return [x for item in items for x in operands(item)]


def _block_of(items: Sequence[Item]) -> Block:
    block = Block(None)
    block.items = list(items)
    return block
