"""A trace as one loop over lanes that Numba compiles, in place of one call of NumPy per operation."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from typing import Any, NamedTuple

import numpy as np

from integ_gym.support import load

from ..trees import leaves_of, map_leaves
from .dialects import Unusual
from .running import executed, in_lanes
from .symbols import Symbol, symbols_in
from .syntax import PYTHON_SYNTAX, tuple_of
from .trace import Trace
from .writer import Writer, target

Function = Callable[..., Any]


class LaneLoop:
    """A step of arrays as a loop over lanes, to the same bits.

    Numba neither reorders nor contracts operations, and calls the sine and cosine of the C library,
    as NumPy does for float64. It compiles at the second call: of the first, which is done as
    written for arrays, the results tell their types.

    Args:
        of_arrays: the step as written for arrays.
        trace: the step's, in the dialect of one lane.
        arguments: its state, what it takes from the call before, and the rest, in symbols; the
            last is an array, and so is what it has computed of the others.
        result: next state, tuples and dictionaries, in symbols.

    Raises:
        ModuleNotFoundError: without Numba.
    """

    def __init__(
        self, of_arrays: Function, trace: Trace, arguments: list[Any], result: tuple[Any, ...]
    ) -> None:
        self._numba = load("numba", "numba")
        self._of_arrays = of_arrays
        self._trace = trace
        self._arguments = arguments
        self._result = result
        self._made: Function | None = None

    def __call__(self, *arguments: Any) -> Any:
        if self._made is not None:
            return self._made(*arguments)
        result = self._of_arrays(*arguments)
        self._made = self._make(result)
        return result

    def _make(self, like: tuple[Any, ...]) -> Function:
        writer = Writer(self._trace)
        body = writer.block(self._trace.block, symbols_in(self._result))
        outputs = _Outputs(self._arguments, writer)
        parts = [outputs.noted(*pair) for pair in zip(self._result, like, strict=True)]
        inputs = [x for x in leaves_of(tuple(self._arguments)) if x.uses]
        loop = self._numba.njit(nogil=True, error_model="numpy")(self._loop(inputs, body, outputs))
        names = {**outputs.types, "empty": np.empty, "in_lanes": in_lanes, "Unusual": Unusual}
        return executed(self._call(inputs, outputs, parts), {**names, "loop": loop})

    def _loop(self, inputs: list[Symbol], body: list[str], outputs: _Outputs) -> Function:
        """The loop: of arrays that it reads, and of arrays that it fills."""
        arrays = [f"of_{x.name}" for x in inputs]
        inside = [f"{x.name} = {array}[lane]" for x, array in zip(inputs, arrays, strict=True)]
        inside += [*body, *(f"{x.name}[lane] = {x.value}" for x in outputs.all)]
        names = ["n", *arrays, *(x.name for x in outputs.all)]
        lines = ["usual = True", *PYTHON_SYNTAX.counting("lane", "n", inside)]
        source = PYTHON_SYNTAX.function(names, names, lines, "usual")
        return executed(source, dict(self._trace.dialect.names))

    def _call(self, inputs: list[Symbol], outputs: _Outputs, parts: list[str]) -> str:
        """Source of what makes the arrays to be filled, and calls the loop."""
        names = [f"a{place}" for place in range(len(self._arguments))]
        targets = [target(PYTHON_SYNTAX, argument) for argument in self._arguments]
        last = targets[-1]
        pairs = zip(leaves_of(self._arguments[0]), leaves_of(self._result[0]), strict=True)
        numbers = [old for old, new in pairs if not isinstance(new, Symbol) and old.uses]
        lines = [f"{x.name} = in_lanes({x.name}, {last})" for x in numbers]
        lines += [f"n = len({last})", *(f"{x.name} = empty(n, {x.type})" for x in outputs.all)]
        passed = ", ".join(x.name for x in (*inputs, *outputs.all))
        lines += [f"if not loop(n, {passed}): raise Unusual"]
        return PYTHON_SYNTAX.function(names, targets, lines, PYTHON_SYNTAX.together(parts))


class _Output(NamedTuple):
    """An array that a loop fills: what it is called, its entry in a lane, its type."""

    name: str
    value: str
    type: str


class _Outputs:
    """What a loop fills: one array for what stands several times in tuples, and one for each entry
    of a dictionary."""

    def __init__(self, arguments: Sequence[Any], writer: Writer) -> None:
        self._given = {id(symbol) for symbol in leaves_of(tuple(arguments))}
        self._writer = writer
        self._by_key: dict[Hashable, _Output] = {}
        self.types: dict[str, Any] = {}

    @property
    def all(self) -> list[_Output]:
        """In the order in which they were noted."""
        return list(self._by_key.values())

    def noted(self, part: Any, like: Any) -> str:
        """Source of a part of a result, with arrays of the types of those in ``like``."""
        if isinstance(part, dict):
            entries = [(name, self._name(leaf, like[name], name)) for name, leaf in part.items()]
            return PYTHON_SYNTAX.entries(entries)
        return tuple_of(map_leaves(self._name, tuple(part), tuple(like)))

    def _name(self, leaf: Any, like: Any, entry: str | None = None) -> str:
        value = self._writer.result(leaf)
        if not isinstance(leaf, Symbol) or (entry is None and id(leaf) in self._given):
            return value
        key = id(leaf) if entry is None else entry
        if key not in self._by_key:
            self.types[like.dtype.name] = like.dtype
            self._by_key[key] = _Output(f"out{len(self._by_key)}", value, like.dtype.name)
        return self._by_key[key].name
