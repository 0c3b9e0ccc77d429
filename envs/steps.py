"""The step of an environment as one straight-line function: traced, compiled, and as JavaScript."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache, partial
from importlib.util import find_spec
from typing import Any, NamedTuple

import numpy as np

from integ_gym.support.errors import InputError

from .ops.ops import (
    ARRAY,
    SCALAR,
    Component,
    Components,
    NotTraceable,
    Ops,
    Unusual,
    map_leaves,
    rows_of,
)
from .settings import Setup
from .starts import Begun
from .transition import EnvState, array_step, initial_state, scalar_start, scalar_step, transition

OBSERVED = 1
"""Place of the observation in what an array step returns."""

WARM_UP = 50
"""Steps of an environment after which the rest are traced: shorter lives are not worth it."""

TRACE_AFTER = 1.0
"""Time that steps of lanes have taken after which the rest are traced if there were fewer, s."""

COMPILE_AFTER = 10.0
"""Time that traced steps of one setup's lanes have taken in this process before they are compiled,
s: it is worth as much again to make the rest take less."""

_CACHE_SIZE = 128
"""Traced functions kept, for environments that are made again."""


def trace_function(setup: Setup, function: Callable[..., Any]) -> Any:
    """A function of a setup as one function without calls, several times as fast.

    Of floats it gives the same bits. It raises ``ArithmeticError`` or ``ValueError`` for an action
    that is not finite, and where a motion diverges or leaves the domain of the scalar arithmetic.
    Of arrays it is a :class:`~.ops.compiling.Repeated`, equal but for the sign of zeros, which
    raises :class:`Unusual` for such an action or motion in any lane. The plain function says what
    follows.

    Args:
        setup: of the environment.
        function: `scalar_step`, `scalar_start` or `array_step` of :mod:`.transition`.

    Returns:
        None where a part cannot be traced, such as a user's integrator that asks ``if x > 0.0``,
        or parameters that differ between lanes.
    """
    found = _trace(setup, function)
    return None if isinstance(found, NotTraceable) else found


def plain_array_step(setup: Setup) -> Callable[..., tuple[Any, ...]]:
    """The step of a setup on arrays, as it is written.

    It takes (state, actions), or (state, drawn, actions) where :attr:`Timing.drawn`, and gives
    (state, observations, values): observations are rows of float32, shape (lanes, n); values are
    `info`, with the solver's status as a code, and `RESULTS`. What is alike in all lanes may be one
    number.
    """
    return partial(_with_rows, partial(array_step, setup, ARRAY))


def compiled_array_step(setup: Setup) -> Any:
    """The traced step as a few loops over lanes that Numba compiles at the second call.

    Raises:
        ValueError: for a setup of which this cannot be done.
        ModuleNotFoundError: without Numba.
    """
    found = _trace(setup, array_step)
    if not isinstance(found, NotTraceable):
        try:
            return _compile_loops(_Key(setup, array_step))
        except NotTraceable as error:
            found = error
    settings = setup.settings
    raise InputError(
        f"`compiled` is not possible with integrator {settings.integrator!r} on engine "
        f"{settings.engine!r}: {found}; leave it out"
    )


class LanesStep:
    """Advances lanes by one control period: by the traced step where it serves.

    Args:
        setup: of the lanes.
        compiled: whether by the one that Numba compiles, from the first step or never; None: where
            Numba is there, once steps have taken the time that this takes.

    Attributes:
        alike: values of the last call that are one number for all lanes; the same mapping for as
            long as they are the same.
    """

    def __init__(self, setup: Setup, compiled: bool | None = None) -> None:
        self._setup = setup
        self._plain = plain_array_step(setup)
        self._asked, self._may_compile = compiled, False
        self._traced: Any = compiled_array_step(setup) if compiled else None
        self._last: EnvState | None = None
        self._carried: Any = ()
        self._steps_to_trace = 0 if compiled else WARM_UP
        self._taken = _Taken()
        self.alike: Mapping[str, Any] = {}

    def __getstate__(self) -> dict[str, Any]:
        """Without the traced step, which cannot be pickled, and is there again when it is made."""
        return {**self.__dict__, "_traced": None}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        if not self._steps_to_trace:
            self._trace()

    def _trace(self) -> None:
        """Trace the step, or compile it where that is asked for."""
        setup = self._setup
        found = compiled_array_step(setup) if self._asked else trace_function(setup, array_step)
        self._traced, self._may_compile = found, self._asked is None and found is not None

    def _choose(self) -> None:
        """Trace the step when it has been made often, and compile it when it has taken long."""
        if self._steps_to_trace > 0:
            self._steps_to_trace -= 1
            if self._steps_to_trace and self._taken.seconds < TRACE_AFTER:
                return
            self._steps_to_trace = 0
            self._trace()
            if self._may_compile:
                self._taken = _taken_of(_Key(self._setup, array_step))
        if self._may_compile and self._taken.seconds >= COMPILE_AFTER:
            self._may_compile = False
            if find_spec("numba") is not None:
                with suppress(Exception):  # such as of a Numba that is too old for NumPy
                    self._traced = compiled_array_step(self._setup)

    @property
    def first(self) -> Callable[[EnvState], tuple[Component, ...]]:
        """What the step takes from the call before, of a state that it has not returned."""
        return _carry_nothing if self._traced is None else self._traced.first

    def begin(self, state: EnvState, lanes: Component, begun: Begun) -> EnvState:
        """``state``, which the step has just returned, with episodes begun in some lanes.

        Its arrays are written into.

        Args:
            state: of all lanes.
            lanes: lane numbers.
            begun: their starts, made with :attr:`first`.
        """
        if state is self._last and self._traced is not None:
            after, self._carried = self._traced.put(state, self._carried, lanes, begun.values)
            self._last = EnvState._make(after)
            return self._last
        values = iter(begun.values)

        def put(old: Component) -> Component:
            array = old if isinstance(old, np.ndarray) else np.full(state.energy.shape, old)
            array[lanes] = next(values)
            return array

        return EnvState._make(map_leaves(put, tuple(state)))

    def __call__(self, state: EnvState, *given: Any) -> tuple[EnvState, Any, dict[str, Any]]:
        """As :func:`plain_array_step`'s, without the values that are :attr:`alike`."""
        begin = time.perf_counter()
        self._choose()
        try:
            return self._advance(state, *given)
        finally:
            self._taken.seconds += time.perf_counter() - begin

    def _advance(self, state: EnvState, *given: Any) -> tuple[EnvState, Any, dict[str, Any]]:
        with np.errstate(all="ignore"):
            if self._traced is not None:
                try:
                    if state is not self._last:
                        self._carried = self._traced.first(state)
                    after, rows, values, self._carried = self._traced.step(
                        state, self._carried, *given
                    )
                    self._last, self.alike = EnvState._make(after), self._traced.alike
                    return self._last, rows, values
                except Unusual:
                    pass
                except Exception:  # of Numba, which nobody has asked for
                    if self._asked is not None or self._may_compile:
                        raise
                    self._trace()
                    self._may_compile = False
            self.alike = {}
            after, rows, values = self._plain(state, *given)
        own = {n: x.copy() if np.ndim(x) else np.asarray(x).item() for n, x in values.items()}
        return after, rows, own


@dataclass
class _Taken:
    """What steps have taken.

    Attributes:
        seconds: of all of them.
    """

    seconds: float = 0.0


def _carry_nothing(state: EnvState) -> tuple[Component, ...]:
    return ()


class _Key:
    """A function of a setup; equals others made of the same classes and arguments."""

    def __init__(self, setup: Setup, function: Callable[..., Any]) -> None:
        self.setup = setup
        self.function = function
        parts = (setup.plant, setup.task, setup.engine, getattr(setup.engine, "integrator", None))
        values = repr(setup.arguments()), setup.timing
        self._parts = (function, *map(type, parts), *values)

    def __hash__(self) -> int:
        return hash(self._parts)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Key) and self._parts == other._parts


def _trace(setup: Setup, function: Callable[..., Any]) -> Any:
    """A traced function of a setup, or why there is none; cached, but for engines with data."""
    if any(isinstance(value, np.ndarray) for value in setup.arguments().values()):
        return NotTraceable("parameters differ between lanes")
    if setup.engine.batched:
        return _trace_once(_Key(setup, function))
    if function is array_step:
        return NotTraceable("it moves lanes one by one")
    return _trace_once.__wrapped__(_Key(setup, function))


@lru_cache(maxsize=_CACHE_SIZE)
def _trace_once(key: _Key) -> Any:
    from .ops.compiling import compile_repeated, compile_trace
    from .ops.dialects import ARRAYS, SCALARS

    setup, function = key.setup, partial(key.function, key.setup)
    try:
        rest, given = _patterns(setup)
        if key.function is scalar_start:
            return compile_trace(SCALARS, function, rest, rest)
        if key.function is scalar_step:
            return compile_trace(SCALARS, function, *given)
        steps = compile_repeated(ARRAYS, function, *given)
        return steps._replace(step=partial(_with_rows, steps.step))
    except Exception as error:  # whatever a part of the user's own does with what is not a float
        known = isinstance(error, NotTraceable)
        return NotTraceable(str(error) if known else f"{type(error).__name__}: {error}")


@lru_cache(maxsize=_CACHE_SIZE)
def _taken_of(key: _Key) -> _Taken:
    """What traced steps of a setup's lanes have taken in this process; one object for all."""
    return _Taken()


@lru_cache(maxsize=_CACHE_SIZE)
def _compile_loops(key: _Key) -> Any:
    from .ops.compiling import compile_loops

    _, given = _patterns(key.setup)
    return compile_loops(_trace_once(key), OBSERVED, partial(key.function, key.setup), *given)


def _with_rows(step: Callable[..., Any], *arguments: Any) -> tuple[Any, ...]:
    """What a step of arrays gives, with the components of observations as rows of float32."""
    after, observed, *rest = step(*arguments)
    return after, rows_of(observed, len(arguments[-1][0]), np.float32), *rest


def _patterns(setup: Setup) -> tuple[Any, Any]:
    """Coordinates of a setup, and what a step takes; True for a truth value, else False."""
    rest = (0.0,) * len(setup.plant.coordinates)
    drawn = ((0.0, 0.0),) * setup.timing.drawn
    action = (0.0,) * setup.action_size
    trees = rest, (tuple(initial_state(SCALAR, setup, rest, rest)), *drawn, action)
    return map_leaves(lambda value: isinstance(value, bool), trees)  # type: ignore[no-any-return]


class Script(NamedTuple):
    """Source of two arrow functions; tuples are arrays."""

    start: str
    """(q, v) to [state, observation]."""
    step: str
    """(state, action) to [state, observation, values], or null where the motion diverges or the
    action is not finite. `values` has `controls` in force at the end, in their units, what `motor`,
    `numerics` and `losses` gave and took in the period, J, and `ended` and `success`."""


def script_of(setup: Setup) -> Script | None:
    """The start and the step of a setup, written down from the one definition of its physics.

    Returns:
        None where they cannot be: where an engine calls what is not of our own arithmetic, a part
        needs to know the value of a component, observations are noisy, or arrivals are drawn.
    """
    from .ops.compiling import source_of
    from .ops.dialects import JAVASCRIPT

    if setup.settings.observation_noise or setup.timing.drawn:
        return None
    try:
        rest, given = _patterns(setup)
        return Script(
            source_of(JAVASCRIPT, partial(_start, setup), rest, rest),
            source_of(JAVASCRIPT, partial(_step, setup), *given),
        )
    except Exception:  # whatever a part of the user's own does with what is not a float
        return None


def _start(setup: Setup, ops: Ops, q: Components, v: Components) -> tuple[Any, ...]:
    return scalar_start(setup, ops, q, v)[:2]


def _step(setup: Setup, ops: Ops, state: tuple[Any, ...], action: Components) -> tuple[Any, ...]:
    after, outcome = transition(ops, setup, EnvState._make(state), action)
    values = {
        "controls": outcome.controls,
        "motor": outcome.work,
        "numerics": outcome.residual_energy,
        "losses": outcome.dissipated + outcome.contact_loss + outcome.clip_loss,
        "ended": outcome.terminated | outcome.truncated,
        "success": outcome.success,
    }
    return tuple(after), setup.task.observe(ops, after.sensed_q, after.sensed_v), values
