"""What a run says, held against what comes out: where plain data differ, and that as a finding."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any, Final, NamedTuple

from integ_gym.evidence.schema import Finding


class Tolerance(NamedTuple):
    """By how much numbers may differ: relative to the larger one, or by this much."""

    rel_tol: float
    abs_tol: float = 0.0


EXACT: Final = Tolerance(1e-12)
"""Of numbers that are written and read again."""

ROUNDING: Final = Tolerance(1e-6, 1e-6)
"""Of numbers that are computed again: other processors and versions add up in another order."""

_NAMES: Final = ("name", "row", "a", "b", "cell", "policy", "episode_index")
"""Keys that tell an entry of a list."""


class _Nothing:
    """What stands under a key that is not there."""

    def __repr__(self) -> str:
        return "nothing"


_NOTHING: Final = _Nothing()


def find_differences(
    place: str, said: Any, expected: Any, tolerance: Tolerance = EXACT
) -> Iterator[tuple[str, Any, Any]]:
    """Places at which plain data differ, with what is there and what should be.

    Args:
        place: of both, keys joined by dots.
        said: as it was read.
        expected: the same, computed.
        tolerance: of numbers.
    """
    if isinstance(said, Mapping) and isinstance(expected, Mapping):
        for key in {**said, **expected}:
            name = f"{place}.{key}".removeprefix(".")
            one, other = said.get(key, _NOTHING), expected.get(key, _NOTHING)
            yield from find_differences(name, one, other, tolerance)
    elif isinstance(said, list | tuple) and isinstance(expected, list | tuple):
        if len(said) != len(expected):
            yield f"len({place})", len(said), len(expected)
            return
        for k, (one, other) in enumerate(zip(said, expected, strict=True)):
            entry = one if isinstance(one, Mapping) else {}
            words = ", ".join(str(entry[name]) for name in _NAMES if entry.get(name) is not None)
            yield from find_differences(f"{place}[{words or k}]", one, other, tolerance)
    elif not _is_same(said, expected, tolerance):
        yield place, said, expected


def _is_same(said: Any, expected: Any, tolerance: Tolerance) -> bool:
    if isinstance(said, bool) or isinstance(expected, bool):
        return said is expected
    numbers = isinstance(said, float | int) and isinstance(expected, float | int)
    if numbers and float in (type(said), type(expected)):
        return math.isclose(said, expected, **tolerance._asdict())
    return bool(said == expected)


def deny(
    file: str,
    record_id: str | None,
    place: str,
    said: Any,
    expected: Any,
    how: str = "planned",
    where: str = "",
    tolerance: Tolerance = EXACT,
) -> Iterator[Finding]:
    """What is recorded otherwise than it is `planned`, or `comes out`, place by place.

    Args:
        file: see :class:`Finding`.
        record_id: likewise.
        place: as of :func:`find_differences`.
        said: likewise.
        expected: likewise.
        how: what the computed is called.
        where: what is meant, before the rest.
        tolerance: of numbers.
    """
    for found in find_differences(place, said, expected, tolerance):
        yield denial(file, record_id, *found, how=how, where=where)


def denial(
    file: str,
    record_id: str | None,
    place: str,
    said: Any,
    expected: Any,
    *,
    how: str,
    where: str = "",
) -> Finding:
    """One of these."""
    message = f"`{place}` is recorded as {said!r:.80}, and {how} as {expected!r:.80}"
    return Finding(file, record_id, f"{where}: {message}" if where else message)
