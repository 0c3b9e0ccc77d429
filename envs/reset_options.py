"""Reading of Gymnasium's reset options."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


def number(options: Mapping[str, Any], name: str, default: float) -> float:
    """Option ``name`` as a float.

    Raises:
        ValueError: if it is not a number.
    """
    value = options.get(name, default)
    try:
        return float(value)
    except (TypeError, ValueError) as error:
        raise ValueError(f"reset option `{name}` must be a number, got {value!r}") from error
