"""A step of arrays as loops over lanes that Numba compiles."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from integ_gym.support import load

from ...array_ops import rows_of
from ...trees import leaves_of
from ..dialects import Unusual
from ..running import executed, in_lanes
from ..symbols import NotTraceable, Symbol
from ..syntax import PYTHON_SYNTAX
from ..trace import Trace
from ..writer import target
from .results import Results
from .writing import written

Function = Callable[..., Any]


class LaneLoop:
    """A step of arrays as loops over lanes, in place of array after array, to the same bits.

    Numba neither reorders nor contracts operations, and calls the sine and cosine of the C library,
    as NumPy does for float64. It compiles at the second call: of the first, which is done as
    written for arrays, the results tell their types.

    Args:
        of_arrays: the step as written for arrays.
        trace: the step's, in the dialect of one lane.
        arguments: its state, what it takes from the call before, and the rest, in symbols; the
            last is an array, and so is what it has computed of the others.
        result: next state, tuples and dictionaries, in symbols.
        table: place of a tuple of the result that is returned as rows of float32 instead.

    Raises:
        ModuleNotFoundError: without Numba.
        NotTraceable: where Numba takes sines from a library of its own.
    """

    def __init__(
        self,
        of_arrays: Function,
        trace: Trace,
        arguments: list[Any],
        result: tuple[Any, ...],
        table: int,
    ) -> None:
        if load("numba", "numba").config.USING_SVML:
            raise NotTraceable(
                "Numba takes sines from Intel's SVML here, which are not NumPy's "
                "(NUMBA_DISABLE_INTEL_SVML=1 makes it take those)"
            )
        self._of_arrays = of_arrays
        self._trace = trace
        self._arguments = arguments
        self._result = result
        self._table = table
        self._made: Function | None = None

    def __call__(self, *arguments: Any) -> Any:
        if self._made is not None:
            return self._made(*arguments)
        with np.errstate(all="ignore"):
            result = self._of_arrays(*arguments)
        self._made = self._make(result)
        rows = rows_of(result[self._table], len(arguments[-1]), np.float32)
        return *result[: self._table], rows, *result[self._table + 1 :]

    def _make(self, like: tuple[Any, ...]) -> Function:
        results = Results(self._arguments, self._result, like, self._table)
        inputs, lines = written(self._trace, self._arguments, results.puts)
        names = ["n", *(f"of_{x.name}" for x in inputs), *(x.name for x in results.arrays)]
        source = PYTHON_SYNTAX.function(names, names, lines, "usual")
        filling = executed(source, {**self._trace.dialect.names, "empty": np.empty, **_TYPES})
        fill = load("numba", "numba").njit(nogil=True, error_model="numpy")(filling)
        types = {x.type: np.dtype(x.type) for x in results.arrays}
        known = {"empty": np.empty, "in_lanes": in_lanes, "Unusual": Unusual, "fill": fill}
        return executed(self._calling(inputs, results), {**known, **types})

    def _calling(self, inputs: list[Symbol], results: Results) -> str:
        """Source of what makes the arrays, has them filled, and returns them."""
        names = [f"a{place}" for place in range(len(self._arguments))]
        targets = [target(PYTHON_SYNTAX, argument) for argument in self._arguments]
        last = targets[-1]
        pairs = zip(leaves_of(self._arguments[0]), leaves_of(self._result[0]), strict=True)
        given = {id(x) for x in leaves_of(tuple(self._arguments))}
        numbers = {id(a) for a, b in pairs if not isinstance(b, Symbol) or id(b) in given}
        lines = [f"{x.name} = in_lanes({x.name}, {last})" for x in inputs if id(x) in numbers]
        lines += [f"n = len({last})"]
        lines += [f"{x.name} = empty({x.shape}, {x.type})" for x in results.arrays]
        passed = ", ".join(["n", *(x.name for x in inputs), *(x.name for x in results.arrays)])
        lines += [f"if not fill({passed}): raise Unusual"]
        return PYTHON_SYNTAX.function(names, targets, lines, PYTHON_SYNTAX.together(results.shown))


_TYPES = {"float64": np.float64, "bool_": np.bool_}
"""Of what is kept between stages."""
