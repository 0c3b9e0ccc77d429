"""Parameters: dataclass fields that carry their unit, meaning and valid range."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import field, fields
from typing import Any

from .errors import InputError

Check = Callable[[Any], str | None]
"""Says what is wrong with a value in a few words, or None."""

LARGEST = 1e30
"""No parameter is larger in size: products of a few stay finite."""

SMALLEST = 1e-30
"""No positive parameter is smaller: quotients of a few stay finite."""


def parameter(default: Any, unit: str, meaning: str, check: Check) -> Any:
    """A dataclass field with a default value, an SI unit, a meaning and a check."""
    return field(default=default, metadata={"unit": unit, "meaning": meaning, "check": check})


def units(owner: Any) -> dict[str, str]:
    """Name to SI unit for every parameter of a dataclass or its instance."""
    return {f.name: f.metadata["unit"] for f in fields(owner)}


def check_values(owner: type, values: Mapping[str, Any]) -> None:
    """Check each value against the range of the field of ``owner`` that it is for.

    Raises:
        ValueError: naming the parameter, what was expected and what came.
    """
    for f in fields(owner):
        if f.name not in values:
            continue
        problem = f.metadata["check"](values[f.name])
        if problem:
            raise InputError(f"`{f.name}` {problem}, got {values[f.name]!r}")


def unknown_name(kind: str, name: str, choices: Iterable[str]) -> str:
    """One sentence that says a name is unknown, guesses what was meant and lists the choices."""
    return f"unknown {kind} {name!r}. {suggestion(name, choices)}"


def suggestion(name: str, choices: Iterable[str]) -> str:
    """What may have been meant by a name, whatever its case, and what there is."""
    known = sorted(choices)
    lower = {choice.lower(): choice for choice in known}
    close = difflib.get_close_matches(name.lower(), lower, n=1)
    guess = f"Did you mean {lower[close[0]]!r}? " if close else ""
    return f"{guess}Valid choices: {', '.join(known) or 'none, there are no names'}"


def is_number(value: Any) -> bool:
    """Whether a value is a number, which a flag is not."""
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def finite_number(value: Any) -> str | None:
    """A finite number, no larger than :data:`LARGEST`."""
    if not (is_number(value) and value - value == 0):
        return "must be a finite number"
    return None if abs(value) <= LARGEST else f"must be at most {LARGEST:g} in size"


def positive(value: Any) -> str | None:
    """A finite number above zero, no smaller than :data:`SMALLEST`."""
    if finite_number(value) is not None or not value > 0:
        return "must be a finite number above 0"
    return None if value >= SMALLEST else f"must be {SMALLEST:g} or above"


def nonnegative(value: Any) -> str | None:
    """A finite number, zero or above."""
    fits = finite_number(value) is None and value >= 0
    return None if fits else "must be a finite number, 0 or above"


def probability(value: Any) -> str | None:
    """A number from 0 to below 1."""
    fits = finite_number(value) is None and 0 <= value < 1
    return None if fits else "must be a number from 0 to below 1"


def boolean(value: Any) -> str | None:
    """True or False."""
    return None if isinstance(value, bool) else "must be True or False"


def text(value: Any) -> str | None:
    """A string."""
    return None if isinstance(value, str) else "must be a string"


def optional(check: Check) -> Check:
    """None, or what ``check`` accepts."""

    def check_optional(value: Any) -> str | None:
        problem = None if value is None else check(value)
        return f"{problem}, or None" if problem else None

    return check_optional


def plain_table(value: Any) -> str | None:
    """A dictionary of numbers, truth values and strings."""
    if isinstance(value, Mapping) and all(
        isinstance(key, str) and isinstance(x, (bool, int, float, str)) for key, x in value.items()
    ):
        return None
    return 'must be like {"iterations": 10}'


def one_of(*choices: str) -> Check:
    """One of the given strings."""

    def check_choice(value: Any) -> str | None:
        return None if value in choices else f"must be one of {', '.join(map(repr, choices))}"

    return check_choice


def texts_of(value: Any) -> list[str]:
    """All texts in plain data, keys left out."""
    if isinstance(value, str):
        return [value]
    inner = value.values() if isinstance(value, Mapping) else value
    return [t for x in inner for t in texts_of(x)] if isinstance(inner, Iterable) else []
