"""Two panels held against each other: what ``panel.json`` says, and what the records come to."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any, Final

import msgspec

from ..model.files import FILE_NAME, read_panel
from ..model.panel import Panel
from ..running.run_directory import RunDirectory

ROUNDING: Final = 1e-6
"""By how much numbers may differ, relative to the larger of 1 and themselves: other processors and
versions add up in another order."""

VOLATILE: Final = ("created", "platform", "instruction_sets")
"""Attributes of a panel that say when and on what machine it was written, and nothing else."""

_CALLED: Final = ("command", "directory", "cost")
"""Attributes that say how the run was called, and what it took."""

_NAMES: Final = ("name", "row", "a", "b", "cell", "policy", "episode_index")
"""Keys that tell an entry of a list."""

_COMMAND: Final = ".query"
"""End of the places of commands, which name the directory."""

Difference = tuple[str, Any, Any]
"""Place, in words, what is said there, and what comes out."""


def differences(said: Panel, made: Panel) -> Iterator[Difference]:
    """What a panel says and is not what comes of its plan and records."""
    yield from _of_parts(said, made, VOLATILE)


def as_sealed(directory: RunDirectory, made: Panel) -> Panel:
    """The panel that a run was sealed with, where it says the same; else the one that was made."""
    if not directory.was_sealed:
        return made
    held = read_panel(directory.path / FILE_NAME)
    other = (place for place, *_ in _of_parts(held, made, (*VOLATILE, *_CALLED)))
    return made if any(not place.endswith(_COMMAND) for place in other) else held


def _of_parts(said: Panel, made: Panel, but: tuple[str, ...]) -> Iterator[Difference]:
    """What differs in all parts but some."""
    one, other = (msgspec.to_builtins(panel) for panel in (said, made))
    for part in one:
        if part not in but:
            yield from _differing(part, one[part], other[part])


def _differing(place: str, said: Any, made: Any) -> Iterator[Difference]:
    if isinstance(said, dict) and isinstance(made, dict):
        for key in {**said, **made}:
            yield from _differing(f"{place}.{key}", said.get(key), made.get(key))
    elif isinstance(said, list | tuple) and isinstance(made, list | tuple):
        if len(said) != len(made):
            yield f"len({place})", len(said), len(made)
            return
        for k, (one, other) in enumerate(zip(said, made, strict=True)):
            yield from _differing(f"{place}[{_named(one, k)}]", one, other)
    elif not _same(said, made):
        yield place, said, made


def _named(entry: Any, place: int) -> str:
    if not isinstance(entry, Mapping):
        return str(place)
    return ", ".join(str(entry[name]) for name in _NAMES if entry.get(name) is not None)


def _same(said: Any, made: Any) -> bool:
    if isinstance(said, float) or isinstance(made, float):
        numbers = isinstance(said, int | float) and isinstance(made, int | float)
        return numbers and math.isclose(said, made, rel_tol=ROUNDING, abs_tol=ROUNDING)
    return bool(said == made)
