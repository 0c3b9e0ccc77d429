"""Nested tuples of components, and dictionaries of them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any


def leaves_of(value: Any) -> list[Any]:
    """Components of a nested tuple, in order."""
    if isinstance(value, tuple):
        return [leaf for part in value for leaf in leaves_of(part)]
    return [value]


def rebuilt(pattern: Any, leaves: Sequence[Any]) -> Any:
    """A nested tuple like ``pattern`` with other components."""
    rest = iter(leaves)

    def build(part: Any) -> Any:
        if not isinstance(part, tuple):
            return next(rest)
        parts = [build(inner) for inner in part]
        return type(part)(*parts) if hasattr(part, "_fields") else tuple(parts)

    return build(pattern)
