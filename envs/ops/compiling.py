"""Source that has been written, made a function of floats or arrays."""

from __future__ import annotations

from collections import ChainMap
from collections.abc import Callable, Sequence
from itertools import count
from typing import Any, NamedTuple

from .dialects import ARRAYS, ONE_LANE, PYTHON_SYNTAX, Dialect, NotTraceable, target, tuple_of
from .lane_loops import LaneLoop
from .ops import leaves_of, map_leaves, rebuilt
from .tracing import Symbol, SymbolicOps, Trace, symbols_in
from .writing import Writer, carried, executed, in_lanes

Function = Callable[..., Any]


def compiled(dialect: Dialect, function: Function, *patterns: Any) -> Function:
    """A function of floats or arrays that does what ``function`` does in the plain world.

    Args:
        dialect: of floats or of arrays.
        function: takes an ``Ops`` and then arguments shaped like ``patterns``; returns tuples,
            dictionaries and components.
        patterns: tuples, nested at will, with True where a truth value stands and False where a
            number does.

    Returns:
        A function of the same arguments without the ``Ops``. It raises :class:`Unusual` where what
        ``function`` expects by ``ops.usually`` does not hold, and, of floats, ``ValueError`` where
        the scalar world gives NaN for an argument outside a function's domain.

    Raises:
        NotTraceable: if ``function`` asks for the value of a component.
    """
    return _written(*_traced(dialect, function, patterns))


def source_of(dialect: Dialect, function: Function, *patterns: Any) -> str:
    """As :func:`compiled`, but what the function is written as, for another to run.

    Of :data:`~.dialects.JAVASCRIPT` it is an arrow function of arrays in the place of tuples, which
    returns null where what ``function`` expects does not hold; it takes and gives the same numbers
    to the rounding of sines and powers, and raises nothing: 1 / 0 is infinite.

    Raises:
        NotTraceable: as there, and for a call that is not of our own arithmetic.
    """
    trace, arguments, result = _traced(dialect, function, patterns)
    if trace.functions:
        raise NotTraceable("a call of somebody else's function cannot be written down")
    return _source(trace, arguments, result)


class Repeated(NamedTuple):
    """A function of arrays that is called again and again on the state that it returns."""

    first: Function
    """(state) to what the first call takes from the call before."""
    step: Function
    """(state, taken, …) to (…, to be taken by the next call)."""
    put: Function
    """(state, taken, lanes, values) to (state, taken): what a call has returned, with other values
    in some lanes, those of all components one after the other. Arrays are written into."""
    alike: dict[str, Any]
    """What is the same in every call of the dictionary that the function returns; the step's
    leaves it out."""


def repeated(dialect: Dialect, function: Function, *patterns: Any) -> Repeated:
    """As :func:`compiled`, for a function from a state, first, to (state, …), shaped alike.

    What it would compute of the state it is given, and has computed of the state that it returned,
    it takes from the call before.
    """
    repeating = _repeating(dialect, function, patterns)
    step = _written(*repeating[:3])
    put = _putting(repeating.result[0], repeating.result[-1])
    trace, (state, *_), _ = _traced(dialect, function, patterns)
    wanted = tuple(trace.block.items[place] for place in repeating.places)
    trace.block.items = [x for x in trace.block.items if isinstance(x, Symbol) and not x.raising]
    return Repeated(_written(trace, [state], wanted), step, put, repeating.alike)


def looped(like: Repeated, table: int, function: Function, *patterns: Any) -> Repeated:
    """``like``, which :func:`repeated` has made of the same, with a step that Numba compiles.

    The step is a few loops over lanes in place of an array operation after the other, and gives the
    same numbers; the last argument must be an array. It is compiled at the second call.

    Args:
        like: see above, with a step that gives what stands at ``table`` as rows of float32, shape
            (lanes, n).
        table: a place in what the function returns.
        function: see :func:`compiled`, as ``patterns``.

    Raises:
        NotTraceable: for what Numba and NumPy do not round alike, for calls of functions that are
            not of our own arithmetic, and for a function that gives another result when it is
            traced again.
        ModuleNotFoundError: without Numba.
    """
    repeating = _repeating(ONE_LANE, function, patterns)
    if repeating.trace.functions:
        raise NotTraceable("a call of somebody else's function is not compiled")
    if _outline(repeating) != _outline(_repeating(ARRAYS, function, patterns)):
        raise NotTraceable("a function that gives another result each time is not compiled")
    return like._replace(step=LaneLoop(like.step, *repeating[:3], table))


class _Repeating(NamedTuple):
    """The step of :class:`Repeated`, in symbols."""

    trace: Trace
    arguments: list[Any]
    result: tuple[Any, ...]
    alike: dict[str, Any]
    places: list[int]
    """Of what is taken from the call before, among the operations of the function as it stands."""


def _repeating(dialect: Dialect, function: Function, patterns: Sequence[Any]) -> _Repeating:
    trace, arguments, result = _traced(dialect, function, patterns)
    pairs = carried(trace.block, arguments[0], result)
    places = [place for place, item in enumerate(trace.block.items) if id(item) in pairs]
    taken = tuple(_taken_out(trace, place) for place in reversed(places))[::-1]
    passed_on = tuple(pairs[id(symbol)] for symbol in taken)
    varying = tuple(_entries(part, varying=True) for part in result)
    alike = [_entries(part, varying=False) for part in result if isinstance(part, dict)]
    arguments = [arguments[0], taken, *arguments[1:]]
    return _Repeating(trace, arguments, (*varying, passed_on), dict(ChainMap(*alike)), places)


def _outline(repeating: _Repeating) -> Any:
    """Where the same stands again in what a step takes and gives, however it is computed.

    Two traces that differ in it cannot take each other's place.
    """
    marks: dict[int, int] = {}
    named = [part if isinstance(part, dict) else {"": part} for part in repeating.result]
    given = [{"": argument} for argument in repeating.arguments]
    return repr(repeating.alike), [
        (name, marks.setdefault(id(x), len(marks)) if isinstance(x, Symbol) else repr(x))
        for part in (*given, *named)
        for name, tree in part.items()
        for x in leaves_of(tree)
    ]


def _entries(part: Any, varying: bool) -> Any:
    """Those entries of a dictionary that vary, or the others; anything else as it is."""
    if not isinstance(part, dict):
        return part
    return {name: x for name, x in part.items() if isinstance(x, Symbol) is varying}


def _putting(state: Any, taken: Any) -> Function:
    """:attr:`Repeated.put`, of what a call returns in symbols and constants."""
    lines: list[str] = []
    seen: set[int] = set()
    for place, leaf in enumerate(leaves_of((state, taken))):
        name = f"x{place}"
        computed = isinstance(leaf, Symbol) and leaf.template
        if computed and id(leaf) in seen:
            continue
        seen.add(id(leaf))
        lines += [] if computed else [f"{name} = in_lanes({name}, x0)"]
        lines.append(f"{name}[lanes] = values[{place}]")
    names = (f"x{place}" for place in count())
    both = map_leaves(lambda _: next(names), (state, taken))
    targets = [tuple_of(both[0]), tuple_of(both[1]), "lanes", "values"]
    source = PYTHON_SYNTAX.function(
        ["state", "taken", "lanes", "values"], targets, lines, tuple_of(both)
    )
    return executed(source, {"in_lanes": in_lanes})


def _traced(
    dialect: Dialect, function: Function, patterns: Sequence[Any]
) -> tuple[Trace, list[Any], Any]:
    """The trace of a function with its arguments, as symbols, and its result."""
    trace = Trace(dialect)
    arguments = [rebuilt(p, [trace.variable(leaf) for leaf in leaves_of(p)]) for p in patterns]
    return trace, arguments, function(SymbolicOps(trace), *arguments)


def _taken_out(trace: Trace, place: int) -> Any:
    """An operation turned into a value that is given."""
    symbol: Any = trace.block.items.pop(place)
    symbol.name, symbol.template, symbol.arguments = trace.new_name(), "", ()
    return symbol


def _written(trace: Trace, arguments: Sequence[Any], result: Any) -> Function:
    source = _source(trace, arguments, result)
    return executed(source, {**trace.dialect.names, **trace.functions, **trace.held})


def _source(trace: Trace, arguments: Sequence[Any], result: Any) -> str:
    syntax, writer = trace.dialect.syntax, Writer(trace)
    names = [f"a{k}" for k in range(len(arguments))]
    targets = [target(syntax, argument) for argument in arguments]
    body = writer.block(trace.block, symbols_in(result))
    return syntax.function(names, targets, body, writer.result(result))
