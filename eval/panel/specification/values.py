"""Values of a specification, each checked by itself."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from integ_gym.support.errors import IntegGymError
from integ_gym.support.parameters import unknown_name

LARGEST_SEED = 2**32 - 1


class SpecError(IntegGymError, ValueError):
    """A specification that cannot be run, in one sentence with the remedy."""


def check_keys(kind: str, data: Mapping[str, Any], valid: Sequence[str]) -> None:
    """Refuse keys of a table that mean nothing."""
    for key in data:
        check_known(kind, key, valid)


def check_known(kind: str, name: str, valid: Iterable[str]) -> None:
    """Refuse a name that is not among the valid ones, which are listed."""
    if name not in valid:
        raise SpecError(unknown_name(kind, name, valid))


def check_unique(label: str, values: Sequence[Any]) -> None:
    """Refuse a list that holds something twice."""
    if len(set(values)) != len(values):
        raise SpecError(f"`{label}` lists something twice: {list(values)}")


def many(value: Any) -> list[Any]:
    """A list, or a single value as one."""
    return value if isinstance(value, list) else [value]


def list_of(data: Mapping[str, Any], key: str) -> list[Any]:
    """A list under a key; empty where it is left out."""
    value = data.get(key, [])
    if not isinstance(value, list):
        raise SpecError(f"`{key}` must be a list, got {value!r}")
    return value


def table(data: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    """A table under a key; empty where it is left out."""
    value = data.get(key, {})
    if not isinstance(value, Mapping):
        raise SpecError(f"`{key}` must be a table, got {value!r}")
    return value


def text(key: str, value: Any) -> str:
    """A name."""
    if not isinstance(value, str) or not value:
        raise SpecError(f"`{key}` must be made of names in quotes, got {value!r}")
    return value


def flag(key: str, value: Any) -> bool:
    """True or false."""
    if not isinstance(value, bool):
        raise SpecError(f"`{key}` must be true or false, got {value!r}")
    return value


def positive(key: str, value: Any) -> float:
    """A finite number above 0."""
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not 0 < value < math.inf:
        raise SpecError(f"`{key}` must be a finite number above 0, got {value!r}")
    return float(value)


def integer(key: str, value: Any) -> int:
    """A whole number from 0 to `LARGEST_SEED`."""
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= LARGEST_SEED:
        raise SpecError(
            f"`{key}` must be made of whole numbers from 0 to {LARGEST_SEED}, got {value!r}"
        )
    return value


def pair_of(key: str, value: Any) -> tuple[str, str]:
    """Two names."""
    if not isinstance(value, list) or len(value) != 2:
        raise SpecError(f"every entry of `{key}` must be a pair of names, got {value!r}")
    return str(value[0]), str(value[1])
