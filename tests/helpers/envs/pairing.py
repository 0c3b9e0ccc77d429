"""Which combinations `make test` runs; the others run in `make test-slow`."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import combinations, product
from typing import Any

import pytest


def covering(*axes: Iterable[Any], strength: int = 2) -> list[Any]:
    """Parameters of a test: the full product, of which few combinations are not marked slow.

    Those few let any values of so many axes meet at least once. They are chosen greedily, the first
    of the product where several are as good, and so are the same in every process.

    Args:
        axes: values of each argument, hashable.
        strength: 1 lets every value occur, 2 every pair of values of two axes.
    """
    whole = list(product(*axes))
    chosen = set(_chosen(whole, strength))
    return [
        pytest.param(*values, marks=() if place in chosen else pytest.mark.slow)
        for place, values in enumerate(whole)
    ]


def _chosen(whole: Sequence[tuple[Any, ...]], strength: int) -> list[int]:
    met = [
        {(axes, tuple(values[k] for k in axes)) for axes in _axes(len(values), strength)}
        for values in whole
    ]
    missing = set().union(*met)
    chosen = []
    while missing:
        chosen.append(max(range(len(whole)), key=lambda place: len(met[place] & missing)))
        missing -= met[chosen[-1]]
    return chosen


def _axes(count: int, strength: int) -> Iterable[tuple[int, ...]]:
    return combinations(range(count), strength)


def pairs(*axes: Iterable[Any], strength: int = 2) -> list[Any]:
    """Few combinations in which any two values of two axes meet, or every value occurs once."""
    whole = list(product(*axes))
    return [whole[place] for place in sorted(_chosen(whole, strength))]


def in_turn(*axes: Iterable[Any]) -> list[tuple[Any, ...]]:
    """Few combinations in which each value of each axis occurs: the n-th of all, in turn."""
    values = [list(axis) for axis in axes]
    return [tuple(own[n % len(own)] for own in values) for n in range(max(map(len, values)))]
