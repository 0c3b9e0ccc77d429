"""The step of an environment: as it is written, and as one straight-line function."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import lru_cache, partial
from typing import Any, NamedTuple

import numpy as np

from integ_gym.support.errors import InputError

from .ops.array_ops import ARRAY, rows_of
from .ops.compiling import (
    Repeated,
    compiled,
    looped,
    repeated,
    source_of,
)
from .ops.dialects import ARRAYS, JAVASCRIPT, SCALARS, NotTraceable, Unusual
from .ops.ops import (
    SCALAR,
    Component,
    Components,
    Ops,
    map_leaves,
)
from .settings import Setup
from .starts import Begun
from .transition import (
    EnvState,
    initial_state,
    quiet_status,
    reset_info,
    step_info,
    transition,
)

ScalarStep = Callable[[EnvState, float], tuple[Any, ...]]
"""(state, action) to (state, observation, reward, terminated, truncated, info, sampled).

In `info`, the solver's status is a code."""

ScalarStart = Callable[[Components, Components], tuple[Any, ...]]
"""(q, v) to (state, observation, info)."""

ArrayStep = Callable[[EnvState, Component], tuple[EnvState, Any, dict[str, Any]]]
"""(state, actions) to (state, observations, told); what is alike in all lanes may be one number.

Observations are rows of float32, shape (lanes, n). Arrays that are told are objects of their own.
They are `info`, with the solver's status as a code, and reward, terminated, truncated and sampled.
"""

OBSERVED = 1
"""Place of the observation in what an :data:`ArrayStep` returns."""

RESULTS = ("reward", "terminated", "truncated", "sampled")
"""What is told beside `info`."""

WARM_UP = 50
"""Steps of an environment after which the rest are traced: shorter lives are not worth it."""

_KEPT = 128
"""Traced functions kept, for environments that are made again."""


def plain_step(setup: Setup) -> ScalarStep:
    """The step of a setup on floats, as it is written."""
    return partial(_scalar_step, setup, SCALAR)


def traced_step(setup: Setup) -> ScalarStep | None:
    """The same step as one function without calls, several times as fast, to the same bits.

    It raises ``ArithmeticError`` or ``ValueError`` for an action that is not finite, and where a
    motion diverges or leaves the domain of the scalar arithmetic; the plain step says what follows.

    Returns:
        None where a part cannot be traced, such as a user's integrator that asks ``if x > 0.0``.
    """
    step: ScalarStep | None = _unless_refused(_traced(setup, _scalar_step))
    return step


def plain_start(setup: Setup) -> ScalarStart:
    """The start of an episode on floats, as it is written."""
    return partial(_scalar_start, setup, SCALAR)


def traced_start(setup: Setup) -> ScalarStart | None:
    """The same as one function without calls; as :func:`traced_step`."""
    start: ScalarStart | None = _unless_refused(_traced(setup, _scalar_start))
    return start


def plain_array_step(setup: Setup) -> ArrayStep:
    """The step of a setup on arrays, as it is written."""
    return partial(_in_rows, partial(_array_step, setup, ARRAY))


def traced_array_step(setup: Setup) -> Repeated | None:
    """The same step as one function without calls; equal, but for the sign of zeros.

    It raises :class:`Unusual` where an action is not finite or a motion diverges, in any lane.

    Returns:
        None where a part cannot be traced, such as parameters that differ between lanes.
    """
    made: Repeated | None = _unless_refused(_traced(setup, _array_step))
    return made


def compiled_array_step(setup: Setup) -> Repeated:
    """The same as a few loops over lanes that Numba compiles at the second call.

    Raises:
        ValueError: for a setup of which this cannot be done.
        ModuleNotFoundError: without Numba.
    """
    made = _traced(setup, _array_step)
    if not isinstance(made, NotTraceable):
        try:
            return _looped(_Key(setup, _array_step))
        except NotTraceable as error:
            made = error
    settings = setup.settings
    raise InputError(
        f"`compiled` cannot be had of integrator {settings.integrator!r} on engine "
        f"{settings.engine!r}: {made}; leave it out"
    )


class LanesStep:
    """Advances lanes by one control period: by the traced step where it serves.

    Args:
        setup: of the lanes.
        compiled: whether from the first step, by the one that Numba compiles.

    Attributes:
        alike: what the last call would have told that is one number for all lanes, and the same
            mapping as long as it says the same.
    """

    def __init__(self, setup: Setup, compiled: bool = False) -> None:
        self._setup = setup
        self._plain = plain_array_step(setup)
        self._trace = compiled_array_step if compiled else traced_array_step
        self._traced = self._trace(setup) if compiled else None
        self._last: EnvState | None = None
        self._carried: Any = ()
        self._steps_to_trace = 0 if compiled else WARM_UP
        self.alike: Mapping[str, Any] = {}

    def __getstate__(self) -> dict[str, Any]:
        """Without the traced step, which cannot be pickled, and is there again when it is made."""
        return {**self.__dict__, "_traced": None}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        if not self._steps_to_trace:
            self._traced = self._trace(self._setup)

    @property
    def first(self) -> Callable[[EnvState], tuple[Component, ...]]:
        """What the step takes from the call before, of a state that it has not returned."""
        return _nothing if self._traced is None else self._traced.first

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

    def __call__(self, state: EnvState, actions: Any) -> tuple[EnvState, Any, dict[str, Any]]:
        """As an :data:`ArrayStep` that leaves out what is :attr:`alike`."""
        if self._steps_to_trace > 0:
            self._steps_to_trace -= 1
            if not self._steps_to_trace:
                self._traced = self._trace(self._setup)
        if self._traced is not None:
            try:
                return self._go_on(self._traced, state, actions)
            except Unusual:
                pass
        self.alike = {}
        with np.errstate(all="ignore"):
            after, rows, told = self._plain(state, actions)
        return after, rows, {name: _own(value) for name, value in told.items()}

    def _go_on(
        self, traced: Repeated, state: EnvState, actions: Any
    ) -> tuple[EnvState, Any, dict[str, Any]]:
        with np.errstate(all="ignore"):
            if state is not self._last:
                self._carried = traced.first(state)
            after, rows, told, self._carried = traced.step(state, self._carried, actions)
        self._last, self.alike = EnvState._make(after), traced.alike
        return self._last, rows, told


def _nothing(state: EnvState) -> tuple[Component, ...]:
    return ()


def _own(value: Component) -> Component:
    """A copy of an array, or one number."""
    return value.copy() if np.ndim(value) else np.asarray(value).item()


def _scalar_start(setup: Setup, ops: Ops, q: Components, v: Components) -> tuple[Any, ...]:
    state = initial_state(ops, setup, q, v)
    observation = setup.task.observe(ops, state.q, state.v)
    return tuple(state), observation, reset_info(state, quiet_status(setup))


def _scalar_step(
    setup: Setup, ops: Ops, state: tuple[Any, ...], action: Component
) -> tuple[Any, ...]:
    after, outcome = transition(ops, setup, EnvState._make(state), action)
    return (
        tuple(after),
        setup.task.observe(ops, after.sensed_q, after.sensed_v),
        outcome.reward,
        outcome.terminated,
        outcome.truncated,
        step_info(setup, after, outcome),
        outcome.sampled,
    )


def _array_step(
    setup: Setup, ops: Ops, state: tuple[Any, ...], action: Component
) -> tuple[EnvState, Components, dict[str, Any]]:
    after, outcome = transition(ops, setup, EnvState._make(state), action)
    told = step_info(setup, after, outcome)
    told |= {name: getattr(outcome, name) for name in RESULTS}
    return after, setup.task.observe(ops, after.sensed_q, after.sensed_v), told


class _Key:
    """A function of a setup; equals others made of the same classes and arguments."""

    def __init__(self, setup: Setup, function: Callable[..., Any]) -> None:
        self.setup = setup
        self.function = function
        parts = (setup.plant, setup.task, setup.engine, getattr(setup.engine, "integrator", None))
        self._parts = (function, *map(type, parts), repr(setup.arguments()))

    def __hash__(self) -> int:
        return hash(self._parts)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Key) and self._parts == other._parts


def _traced(setup: Setup, function: Callable[..., Any]) -> Any:
    """A traced function of a setup, or why there is none; kept, but for engines with data."""
    if any(isinstance(value, np.ndarray) for value in setup.arguments().values()):
        return NotTraceable("parameters differ between lanes")
    if setup.engine.batched:
        return _kept(_Key(setup, function))
    if function is _array_step:
        return NotTraceable("it moves lanes one by one")
    return _tried(setup, function)


@lru_cache(maxsize=_KEPT)
def _kept(key: _Key) -> Any:
    return _tried(key.setup, key.function)


def _tried(setup: Setup, function: Callable[..., Any]) -> Any:
    try:
        return _made(setup, function)
    except Exception as error:  # whatever a part of the user's own does with what is not a float
        known = isinstance(error, NotTraceable)
        return NotTraceable(str(error) if known else f"{type(error).__name__}: {error}")


def _made(setup: Setup, function: Callable[..., Any]) -> Any:
    of_setup, rest = partial(function, setup), _at_rest(setup)
    if function is _scalar_start:
        return compiled(SCALARS, of_setup, truths(rest), truths(rest))
    state = _state_pattern(setup, rest)
    if function is _scalar_step:
        return compiled(SCALARS, of_setup, state, False)
    made = repeated(ARRAYS, of_setup, state, False)
    return made._replace(step=partial(_in_rows, made.step))


def _unless_refused(made: Any) -> Any:
    return None if isinstance(made, NotTraceable) else made


def _in_rows(step: Callable[..., Any], *arguments: Any) -> tuple[Any, ...]:
    """What a step of arrays gives, with the components of observations as rows of float32."""
    after, observed, *rest = step(*arguments)
    return after, rows_of(observed, len(arguments[-1]), np.float32), *rest


@lru_cache(maxsize=_KEPT)
def _looped(key: _Key) -> Repeated:
    state = _state_pattern(key.setup, _at_rest(key.setup))
    return looped(_kept(key), OBSERVED, partial(key.function, key.setup), state, False)


def _at_rest(setup: Setup) -> Components:
    return (0.0,) * len(setup.plant.coordinates)


def _state_pattern(setup: Setup, rest: Components) -> Any:
    """Where truth values stand in a state."""
    return truths(tuple(initial_state(SCALAR, setup, rest, rest)))


def truths(values: tuple[Any, ...]) -> Any:
    """True where a truth value stands, False where a number does."""
    return map_leaves(lambda value: isinstance(value, bool), values)


class Script(NamedTuple):
    """Source of two arrow functions; tuples are arrays."""

    start: str
    """(q, v) to [state, observation]."""
    step: str
    """(state, action) to [state, observation, told], or null where the motion diverges or the
    action is not finite. `told` has `control` in force at the end, N or N m, what `motor`,
    `numerics` and `losses` gave and took in the period, J, and `ended` and `success`."""


def script_of(setup: Setup) -> Script | None:
    """The start and the step of a setup, written down from the one definition of its physics.

    Returns:
        None where they cannot be: where an engine calls what is not of our own arithmetic, a part
        needs to know the value of a component, or observations are noisy.
    """
    if setup.settings.observation_noise:
        return None
    rest = (0.0,) * len(setup.plant.coordinates)
    try:
        state = tuple(initial_state(SCALAR, setup, rest, rest))
        return Script(
            source_of(JAVASCRIPT, partial(_start, setup), truths(rest), truths(rest)),
            source_of(JAVASCRIPT, partial(_step, setup), truths(state), False),
        )
    except Exception:  # whatever a part of the user's own does with what is not a float
        return None


def _start(setup: Setup, ops: Ops, q: Components, v: Components) -> tuple[Any, ...]:
    state = initial_state(ops, setup, q, v)
    return tuple(state), setup.task.observe(ops, state.q, state.v)


def _step(setup: Setup, ops: Ops, state: tuple[Any, ...], action: Component) -> tuple[Any, ...]:
    after, outcome = transition(ops, setup, EnvState._make(state), action)
    told = {
        "control": outcome.control,
        "motor": outcome.work,
        "numerics": outcome.residual_energy,
        "losses": outcome.dissipated + outcome.contact_loss + outcome.clip_loss,
        "ended": outcome.terminated | outcome.truncated,
        "success": outcome.success,
    }
    return tuple(after), setup.task.observe(ops, after.sensed_q, after.sensed_v), told
