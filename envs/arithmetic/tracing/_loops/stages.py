"""A trace parted into loops over lanes: sines and cosines apart, the rest as vectors can do it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from ..dialects import called
from ..liveness import live_items, needed
from ..symbols import Symbol
from ..trace import Block, Loop

Item = Symbol | Loop

_APART = (called("sin", 1), called("cos", 1))
"""Calls of the C library, which a compiler does for one lane at a time."""


def stages(block: Block, wanted: Sequence[Symbol]) -> list[list[Item]]:
    """Operations that the wanted symbols need, in stages that each need what is before alone.

    Every second stage has nothing but sines and cosines, as early as can be; the others are done as
    late as can be, so that little is kept between stages.
    """
    items = live_items(block, wanted)
    stage_of: dict[int, int] = {}
    for item in items:
        after = max((stage_of.get(id(x), 0) for x in operands(item)), default=0)
        _put(stage_of, item, after + (after + _is_apart(item)) % 2)
    last = max((stage + stage % 2 for stage in stage_of.values()), default=0)
    latest: dict[int, int] = {}
    for item in reversed(items):
        if not _is_apart(item):
            stage = min((latest.get(id(x), last) for x in made_in([item])), default=last)
            _put(stage_of, item, stage - stage % 2)
        for x in operands(item):
            latest[id(x)] = min(latest.get(id(x), last), stage_of[id(made_in([item])[0])])
    return [
        [item for item in items if stage_of[id(made_in([item])[0])] == stage]
        for stage in range(last + 1)
    ]


def operands(item: Item) -> list[Symbol]:
    """Symbols that an operation is done on; of a loop also those that are made within."""
    if isinstance(item, Symbol):
        return needed(item)
    inner = [x for other in item.inner.items for x in operands(other)]
    return [*needed(item), *item.wanted, *inner]


def made_in(items: Iterable[Item]) -> list[Symbol]:
    """Symbols that operations and loops give a value."""
    return [x for item in items for x in ([item] if isinstance(item, Symbol) else item.variables)]


def _is_apart(item: Item) -> bool:
    return isinstance(item, Symbol) and item.template in _APART


def _put(stage_of: dict[int, int], item: Item, stage: int) -> None:
    stage_of.update((id(x), stage) for x in made_in([item]))
