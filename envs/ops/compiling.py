"""Traces made functions of floats or arrays, and loops over lanes that Numba compiles."""

from __future__ import annotations

from collections import ChainMap
from collections.abc import Callable, Hashable, Iterable, Sequence
from functools import partial
from itertools import chain, count
from threading import Lock
from typing import Any, NamedTuple

import numpy as np

from integ_gym.support.optional import load

from .dialects import ARRAYS, ONE_LANE, PYTHON_SYNTAX, Dialect, call_template, target, tuple_of
from .ops import NotTraceable, Unusual, leaves_of, map_leaves, rebuild
from .tracing import Block, Loop, Symbol, SymbolicOps, Trace, symbols_in
from .writing import Writer, execute, find_carried, in_lanes, live_items, needed_symbols


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


Item = Symbol | Loop

_APART = (call_template("sin", 1), call_template("cos", 1))
"""Calls of the C library, which a compiler does for one lane at a time."""


def split_stages(block: Block, wanted: Sequence[Symbol]) -> list[list[Item]]:
    """Operations that the wanted symbols need, in stages that each need what is before alone.

    Every second stage has nothing but sines and cosines, as early as can be; the others are done as
    late as can be, so that little is kept between stages.
    """
    items = live_items(block, wanted)
    stage_of: dict[int, int] = {}
    for item in items:
        after = max((stage_of.get(id(x), 0) for x in operands(item)), default=0)
        _put(stage_of, item, after + (after + _is_apart(item)) % 2)
    last = max((stage + stage % 2 for stage in stage_of.values()), default=0)
    latest: dict[int, int] = {}
    for item in reversed(items):
        if not _is_apart(item):
            stage = min((latest.get(id(x), last) for x in symbols_made_in([item])), default=last)
            _put(stage_of, item, stage - stage % 2)
        for x in operands(item):
            latest[id(x)] = min(latest.get(id(x), last), stage_of[id(symbols_made_in([item])[0])])
    return [
        [item for item in items if stage_of[id(symbols_made_in([item])[0])] == stage]
        for stage in range(last + 1)
    ]


def operands(item: Item) -> list[Symbol]:
    """Symbols that an operation is done on; of a loop also those that are made within."""
    if isinstance(item, Symbol):
        return needed_symbols(item)
    inner = [x for other in item.inner.items for x in operands(other)]
    return [*needed_symbols(item), *item.wanted, *inner]


def symbols_made_in(items: Iterable[Item]) -> list[Symbol]:
    """Symbols that operations and loops give a value."""
    return [x for item in items for x in ([item] if isinstance(item, Symbol) else item.variables)]


def _is_apart(item: Item) -> bool:
    return isinstance(item, Symbol) and item.template in _APART


def _put(stage_of: dict[int, int], item: Item, stage: int) -> None:
    stage_of.update((id(x), stage) for x in symbols_made_in([item]))


def write_loops(
    trace: Trace, arguments: Sequence[Any], puts: Sequence[Put]
) -> tuple[list[Symbol], list[str]]:
    """One loop per stage.

    Args:
        trace: in the dialect of one lane.
        arguments: symbols that are given, each as an array called ``of_`` and its name.
        puts: what lanes put where.

    Returns:
        What of the arguments is read, and statements. Whether all was as expected is ``usual``.
    """
    parted = split_stages(trace.block, _values(puts))
    made = {id(x): place for place, items in enumerate(parted) for x in symbols_made_in(items)}
    puts_of: list[list[Put]] = [[] for _ in parted]
    for put in puts:
        puts_of[made.get(id(put.value), -1)].append(put)
    needs = [
        {id(x): x for x in (*chain.from_iterable(map(operands, items)), *_values(own))}
        for items, own in zip(parted, puts_of, strict=True)
    ]
    given = leaves_of(tuple(arguments))
    found = {id(x): f"of_{x.name}[lane]" for x in given}
    found |= {id(put.value): put.where for put in puts if put.exact and id(put.value) in made}
    writer = Writer(trace)
    lines = ["usual = True"]
    for place, items in enumerate(parted):
        before = [x for key, x in needs[place].items() if made.get(key, -1) < place]
        kept = [
            x for x in symbols_made_in(items) if any(id(x) in later for later in needs[place + 1 :])
        ]
        body = writer.block(_block_of(items), [*kept, *_values(puts_of[place])])
        stores = [f"{put.where} = {writer.result(put.value)}" for put in puts_of[place]]
        for x in kept:
            if id(x) not in found:
                lines.append(f"of_{x.name} = empty(n, {'bool_' if x.boolean else 'float64'})")
                stores.append(f"of_{x.name}[lane] = {x.name}")
                found[id(x)] = f"of_{x.name}[lane]"
        reads = [f"{x.name} = {found[id(x)]}" for x in before if id(x) in found]
        lines += PYTHON_SYNTAX.count_loop("lane", "n", [*reads, *body, *stores])
    return [x for x in given if any(id(x) in need for need in needs)], lines


def _values(puts: Sequence[Put]) -> list[Symbol]:
    return symbols_in(tuple(put.value for put in puts))


def _block_of(items: Sequence[Item]) -> Block:
    block = Block(None)
    block.items = list(items)
    return block


Function = Callable[..., Any]


class LaneLoop:
    """A step of arrays as loops over lanes, in place of array after array, to the same bits.

    Numba neither reorders nor contracts operations, and calls the sine and cosine of the C library,
    as NumPy does for float64. It compiles at the second call: of the first, which is done as
    written for arrays, the results tell their types.

    Args:
        of_arrays: the step as written for arrays, which gives the table as rows.
        repeating: the step in the dialect of one lane, whose last argument is of arrays, and so is
            what it has computed of the others.
        table: place of a tuple of the result that is returned as rows of float32 instead.

    Raises:
        ModuleNotFoundError: without Numba.
        NotTraceable: where Numba takes sines from a library of its own.
    """

    def __init__(self, of_arrays: Function, repeating: _Repeating, table: int) -> None:
        if load("numba", "numba").config.USING_SVML:
            raise NotTraceable(
                "Numba takes sines from Intel's SVML here, which are not NumPy's "
                "(NUMBA_DISABLE_INTEL_SVML=1 makes it take those)"
            )
        self._of_arrays = of_arrays
        making = partial(_build_step, repeating, table)
        self._make: Callable[[Any], Function] | None = making
        self._build_step: Function | None = None
        self._making = Lock()

    def __call__(self, *arguments: Any) -> Any:
        if self._build_step is not None:
            return self._build_step(*arguments)
        lanes = leaves_of(arguments[-1:])[0]
        like = self._of_arrays(*map_leaves(lambda x: in_lanes(x, lanes), arguments))
        with self._making:
            if self._make is not None:
                self._build_step, self._make = self._make(like), None
        return like


def _build_step(repeating: _Repeating, table: int, like: tuple[Any, ...]) -> Function:
    """What does the step, of a result of whose types its own are."""
    trace, arguments, result = repeating[:3]
    results = Results(arguments, result, like, table)
    inputs, lines = write_loops(trace, arguments, results.puts)
    names = ["n", *(f"of_{x.name}" for x in inputs), *(x.name for x in results.arrays)]
    source = PYTHON_SYNTAX.function(names, names, lines, "usual")
    filling = execute(source, {**trace.dialect.names, "empty": np.empty, **_TYPES})
    fill = load("numba", "numba").njit(nogil=True, error_model="numpy")(filling)
    types = {x.type: np.dtype(x.type) for x in results.arrays}
    known = {"empty": np.empty, "in_lanes": in_lanes, "Unusual": Unusual, "fill": fill}
    return execute(_write_call(arguments, result[0], inputs, results), {**known, **types})


def _write_call(arguments: list[Any], state: Any, inputs: list[Symbol], results: Results) -> str:
    """Source of what makes the arrays, has them filled, and returns them."""
    names = [f"a{place}" for place in range(len(arguments))]
    targets = [target(PYTHON_SYNTAX, argument) for argument in arguments]
    last = leaves_of(tuple(arguments[-1:]))[0].name
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


def compile_trace(dialect: Dialect, function: Function, *patterns: Any) -> Function:
    """A function of floats or arrays that does what ``function`` does in the plain world.

    Args:
        dialect: of floats or of arrays.
        function: takes an ``Ops`` and then arguments shaped like ``patterns``; returns tuples,
            dictionaries and components.
        patterns: tuples, nested at will, with True where a truth value stands and False where a
            number does.

    Returns:
        A function of the same arguments without the ``Ops``. It raises :class:`Unusual` where what
        ``function`` assumes does not hold, and, of floats, ``ValueError`` where the scalar world
        gives NaN for an argument outside a function's domain.

    Raises:
        NotTraceable: if ``function`` asks for the value of a component.
    """
    return _compile_source(*_trace(dialect, function, patterns))


def source_of(dialect: Dialect, function: Function, *patterns: Any) -> str:
    """As :func:`compile_trace`, but what the function is written as, for another to run.

    Of :data:`~.dialects.JAVASCRIPT` it is an arrow function of arrays in the place of tuples, which
    returns null where what ``function`` expects does not hold; it takes and gives the same numbers
    to the rounding of sines and powers, and raises nothing: 1 / 0 is infinite.

    Raises:
        NotTraceable: as there, and for a call that is not of our own arithmetic.
    """
    trace, arguments, result = _trace(dialect, function, patterns)
    if trace.functions:
        raise NotTraceable("a call of a foreign function cannot be written down")
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


def compile_repeated(dialect: Dialect, function: Function, *patterns: Any) -> Repeated:
    """As :func:`compile_trace`, for a function from a state, first, to (state, …), shaped alike.

    What it would compute of the state it is given, and has computed of the state that it returned,
    it takes from the call before.
    """
    repeating = _repeating(dialect, function, patterns)
    step = _compile_source(*repeating[:3])
    put = _write_put(repeating.result[0], repeating.result[-1])
    trace, (state, *_), _ = _trace(dialect, function, patterns)
    wanted = tuple(trace.block.items[place] for place in repeating.places)
    trace.block.items = [x for x in trace.block.items if isinstance(x, Symbol) and not x.raising]
    return Repeated(_compile_source(trace, [state], wanted), step, put, repeating.alike)


def compile_loops(like: Repeated, table: int, function: Function, *patterns: Any) -> Repeated:
    """What :func:`compile_repeated` has made of the same, with a step that Numba compiles.

    The step is a few loops over lanes in place of an array operation after the other, and gives the
    same numbers; the last argument must be of arrays. It is compiled at the second call.

    Args:
        like: see above, with a step that gives what stands at ``table`` as rows of float32, shape
            (lanes, n).
        table: a place in what the function returns.
        function: see :func:`compile_trace`, as ``patterns``.

    Raises:
        NotTraceable: for what Numba and NumPy do not round alike, for calls of functions that are
            not of our own arithmetic, and for a function that gives another result when it is
            traced again.
        ModuleNotFoundError: without Numba.
    """
    repeating = _repeating(ONE_LANE, function, patterns)
    if repeating.trace.functions:
        raise NotTraceable("a call of a foreign function is not compiled")
    if _outline(repeating) != _outline(_repeating(ARRAYS, function, patterns)):
        raise NotTraceable("a function that gives another result each time is not compiled")
    return like._replace(step=LaneLoop(like.step, repeating, table))


class _Repeating(NamedTuple):
    """The step of :class:`Repeated`, in symbols."""

    trace: Trace
    arguments: list[Any]
    """Its state, what it takes from the call before, and the rest."""
    result: tuple[Any, ...]
    """Next state, tuples and dictionaries, and what is taken by the next call."""
    alike: dict[str, Any]
    places: list[int]
    """Of what is taken from the call before, among the operations of the function as it stands."""


def _repeating(dialect: Dialect, function: Function, patterns: Sequence[Any]) -> _Repeating:
    trace, arguments, result = _trace(dialect, function, patterns)
    pairs = find_carried(trace.block, arguments[0], result)
    places = [place for place, item in enumerate(trace.block.items) if id(item) in pairs]
    taken = tuple(_take_out(trace, place) for place in reversed(places))[::-1]
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


def _write_put(state: Any, taken: Any) -> Function:
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
    return execute(source, {"in_lanes": in_lanes})


def _trace(
    dialect: Dialect, function: Function, patterns: Sequence[Any]
) -> tuple[Trace, list[Any], Any]:
    """The trace of a function with its arguments, as symbols, and its result."""
    trace = Trace(dialect)
    arguments = [rebuild(p, [trace.variable(leaf) for leaf in leaves_of(p)]) for p in patterns]
    return trace, arguments, function(SymbolicOps(trace), *arguments)


def _take_out(trace: Trace, place: int) -> Any:
    """An operation turned into a value that is given."""
    symbol: Any = trace.block.items.pop(place)
    symbol.name, symbol.template, symbol.arguments = trace.new_name(), "", ()
    return symbol


def _compile_source(trace: Trace, arguments: Sequence[Any], result: Any) -> Function:
    source = _source(trace, arguments, result)
    return execute(source, {**trace.dialect.names, **trace.functions, **trace.held})


def _source(trace: Trace, arguments: Sequence[Any], result: Any) -> str:
    syntax, writer = trace.dialect.syntax, Writer(trace)
    names = [f"a{k}" for k in range(len(arguments))]
    targets = [target(syntax, argument) for argument in arguments]
    body = writer.block(trace.block, symbols_in(result))
    return syntax.function(names, targets, body, writer.result(result))
