"""Operations on finite numbers that need not be done."""

from __future__ import annotations

from typing import Any

from .symbols import is_boolean

_NEUTRAL = {
    "{0} + {1}": (0.0, 0.0),
    "{0} - {1}": (None, 0.0),
    "{0} * {1}": (1.0, 1.0),
    "{0} / {1}": (None, 1.0),
}
"""Numbers that change nothing, by their place in an operation."""

_ABSORBING = {"{0} * {1}": (0.0, 0.0), "{0} / {1}": (0.0, None)}
"""Numbers that leave nothing."""


def folded(template: str, arguments: tuple[Any, ...]) -> Any:
    """What an operation with 0.0 or 1.0 on finite numbers comes to, or None if it must be done."""
    if template not in _NEUTRAL:
        return None
    for place, number in enumerate(arguments):
        other = arguments[1 - place]
        if type(number) is not float or is_boolean(other):
            continue
        if number == _ABSORBING.get(template, (None, None))[place]:
            return 0.0
        if number == _NEUTRAL[template][place]:
            return other
    return None
