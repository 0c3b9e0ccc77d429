"""What a check finds."""

from __future__ import annotations

import math
from typing import Any

from ..schema.errors import Finding


def deviation(file: str, record_id: str, field: str, recorded: Any, computed: Any) -> Finding:
    """That a record's field is not what it was computed to be."""
    message = f"`{field}` is recorded as {recorded!r}, and comes out as {computed!r}"
    return Finding(file, record_id, message)


def same(recorded: Any, computed: Any, tolerance: float, scale: float = 0.0) -> bool:
    """Whether two values agree.

    Args:
        recorded: a number, or anything else, which must be equal.
        computed: the same.
        tolerance: of numbers, relative to the larger of 1, themselves and ``scale``.
        scale: what a number was added up from.
    """
    if not (is_number(recorded) and is_number(computed)):
        return bool(recorded == computed)
    if math.isnan(recorded) or math.isnan(computed):
        return math.isnan(recorded) and math.isnan(computed)
    if recorded == computed:
        return True
    largest = max(1.0, abs(recorded), abs(computed), scale)
    return bool(abs(recorded - computed) <= tolerance * largest)


def is_number(value: Any) -> bool:
    """Whether a value is a number, which a flag is not."""
    return isinstance(value, int | float) and not isinstance(value, bool)
