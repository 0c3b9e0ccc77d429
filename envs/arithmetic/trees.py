"""Nested tuples of components."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any


def map_leaves(function: Callable[..., Any], tree: Any, *others: Any) -> Any:
    """``function`` of every component in nested (named) tuples, and of those that stand there in
    ``others``, which are shaped alike."""
    values = [
        map_leaves(function, *alike) if isinstance(alike[0], tuple) else function(*alike)
        for alike in zip(tree, *others, strict=True)
    ]
    return type(tree)(*values) if hasattr(tree, "_fields") else tuple(values)


def leaves_of(value: Any) -> list[Any]:
    """Components of a nested tuple, in order."""
    if isinstance(value, tuple):
        return [leaf for part in value for leaf in leaves_of(part)]
    return [value]


def rebuilt(pattern: Any, leaves: Sequence[Any]) -> Any:
    """A nested tuple like ``pattern`` with other components."""
    rest = iter(leaves)
    (tree,) = map_leaves(lambda _: next(rest), (pattern,))
    return tree
