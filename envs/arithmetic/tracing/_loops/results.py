"""The arrays that loops over lanes fill, and the result that they make up."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from typing import Any, NamedTuple

from ...trees import leaves_of, map_leaves
from ..symbols import Symbol
from ..syntax import PYTHON_SYNTAX, tuple_of


class Filled(NamedTuple):
    """An array: source of its name, shape and type."""

    name: str
    shape: str
    type: str


class Put(NamedTuple):
    """A number that a lane puts somewhere."""

    where: str
    """Source, such as ``out3[lane]``."""
    value: Any
    """A symbol or constant."""
    exact: bool
    """Whether what is put there is what is read there."""


class Results:
    """What stands twice in tuples is one array; an entry of a dictionary is one of its own.

    Args:
        arguments: symbols that are given.
        result: tuples and dictionaries, in symbols and constants.
        like: the same of arrays, of the types of those that are filled.
        table: place of a tuple of the result that is one array of float32, shape (n, parts).

    Attributes:
        arrays: to be filled.
        puts: what fills them.
        shown: source of the parts of the result.
    """

    def __init__(
        self, arguments: Sequence[Any], result: Sequence[Any], like: Sequence[Any], table: int
    ) -> None:
        self.arrays: list[Filled] = []
        self.puts: list[Put] = []
        self._given = {id(x): x.name for x in leaves_of(tuple(arguments))}
        self._names: dict[Hashable, str] = {}
        self.shown = [
            self._rows(part) if place == table else self._part(part, like[place])
            for place, part in enumerate(result)
        ]

    def _rows(self, part: Sequence[Any]) -> str:
        self.arrays.append(Filled("rows", f"(n, {len(part)})", "float32"))
        self.puts += [Put(f"rows[lane, {place}]", x, False) for place, x in enumerate(part)]
        return "rows"

    def _part(self, part: Any, like: Any) -> str:
        if isinstance(part, dict):
            entries = [(name, self._array(name, x, like[name])) for name, x in part.items()]
            return PYTHON_SYNTAX.entries(entries)
        return tuple_of(map_leaves(self._leaf, tuple(part), tuple(like)))

    def _leaf(self, leaf: Any, like: Any) -> str:
        if not isinstance(leaf, Symbol):
            return PYTHON_SYNTAX.constant(leaf)
        return self._given.get(id(leaf)) or self._array(id(leaf), leaf, like)

    def _array(self, key: Hashable, value: Any, like: Any) -> str:
        if key not in self._names:
            name = self._names[key] = f"out{len(self.arrays)}"
            self.arrays.append(Filled(name, "n", like.dtype.name))
            self.puts.append(Put(f"{name}[lane]", value, True))
        return self._names[key]
