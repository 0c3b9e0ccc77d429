"""A step of arrays as loops over lanes that Numba compiles."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from threading import Lock
from typing import Any

import numpy as np

from integ_gym.support.packages.extras import load

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
        of_arrays: the step as written for arrays, which gives the table as rows.
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
        making = partial(_made, trace, arguments, result, table)
        self._make: Callable[[Any], Function] | None = making
        self._made: Function | None = None
        self._making = Lock()

    def __call__(self, *arguments: Any) -> Any:
        if self._made is not None:
            return self._made(*arguments)
        like = self._of_arrays(*arguments)
        with self._making:
            if self._make is not None:
                self._made, self._make = self._make(like), None
        return like


def _made(
    trace: Trace,
    arguments: list[Any],
    result: tuple[Any, ...],
    table: int,
    like: tuple[Any, ...],
) -> Function:
    """What does the step, of a result of whose types its own are."""
    results = Results(arguments, result, like, table)
    inputs, lines = written(trace, arguments, results.puts)
    names = ["n", *(f"of_{x.name}" for x in inputs), *(x.name for x in results.arrays)]
    source = PYTHON_SYNTAX.function(names, names, lines, "usual")
    filling = executed(source, {**trace.dialect.names, "empty": np.empty, **_TYPES})
    fill = load("numba", "numba").njit(nogil=True, error_model="numpy")(filling)
    types = {x.type: np.dtype(x.type) for x in results.arrays}
    known = {"empty": np.empty, "in_lanes": in_lanes, "Unusual": Unusual, "fill": fill}
    return executed(_calling(arguments, result[0], inputs, results), {**known, **types})


def _calling(arguments: list[Any], state: Any, inputs: list[Symbol], results: Results) -> str:
    """Source of what makes the arrays, has them filled, and returns them."""
    names = [f"a{place}" for place in range(len(arguments))]
    targets = [target(PYTHON_SYNTAX, argument) for argument in arguments]
    last = targets[-1]
    pairs = zip(leaves_of(arguments[0]), leaves_of(state), strict=True)
    given = {id(x) for x in leaves_of(tuple(arguments))}
    numbers = {id(a) for a, b in pairs if not isinstance(b, Symbol) or id(b) in given}
    lines = [f"{x.name} = in_lanes({x.name}, {last})" for x in inputs if id(x) in numbers]
    lines += [f"n = len({last})"]
    lines += [f"{x.name} = empty({x.shape}, {x.type})" for x in results.arrays]
    passed = ", ".join(["n", *(x.name for x in inputs), *(x.name for x in results.arrays)])
    lines += [f"if not fill({passed}): raise Unusual"]
    return PYTHON_SYNTAX.function(names, targets, lines, PYTHON_SYNTAX.together(results.shown))


_TYPES = {"float64": np.float64, "bool_": np.bool_}
"""Of what is kept between stages."""
