"""Source that has been written, made a function of floats or arrays."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np


def executed(source: str, names: dict[str, Any]) -> Callable[..., Any]:
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
