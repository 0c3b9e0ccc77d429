"""Starts: drawn or given, checked; of many lanes at once, each from its lane's own generator."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from itertools import repeat
from operator import itemgetter
from typing import Any, NamedTuple

import numpy as np

from integ_gym.support.errors import InputError
from integ_gym.support.parameters import unknown_name

from .engines.stepping import DIVERGENCE_SPEED, within_bounds
from .ops.ops import (
    ARRAY,
    Array,
    Component,
    Components,
    leaves_of,
    rows_of,
    split_state,
)
from .plants.interface import state_names
from .settings import Setup
from .tasks.interface import to_public_order, to_state_order
from .transition import EnvState, initial_state

NOISE, MEMBER, ARRIVAL = 0x4E01, 0x4E02, 0x4E03
"""What streams beside that of the starts are for; apart from the numbers that ``spawn`` gives."""


def stream_of_episode(starts: np.random.Generator, use: int, episode: int) -> np.random.Generator:
    """A generator for one episode, beside the one that draws starts.

    What is drawn from it leaves the starts as they are, however long an episode lasts, and can be
    drawn again without the episodes before.

    Args:
        starts: whose seed it has; nothing is drawn from it.
        use: `NOISE`, `MEMBER` or `ARRIVAL`.
        episode: how many episodes have begun since the seed.
    """
    seeds: Any = starts.bit_generator.seed_seq
    key = (*seeds.spawn_key, use, episode)
    return np.random.Generator(
        np.random.PCG64(np.random.SeedSequence(seeds.entropy, spawn_key=key))
    )


def draw_start(setup: Setup, rng: np.random.Generator, options: Mapping[str, Any]) -> Components:
    """A start in state order, drawn or given as option ``state``."""
    check_options(setup, options)
    if "state" in options:
        return parse_state(setup, options["state"])
    start = setup.task.draw_start(rng, setup.settings.start, options)
    return _check_size(setup, tuple([float(x) for x in start]))


def check_options(setup: Setup, options: Mapping[str, Any], more: tuple[str, ...] = ()) -> None:
    """Check the names of reset options.

    Args:
        setup: of the environment.
        options: by name.
        more: names that are known beside those of every environment and of the task.

    Raises:
        ValueError: for one that the task does not know, with those it does.
    """
    known = ("state", "episode", "reset_mask", *setup.task.start_options, *more)
    for name in options:
        if name not in known:
            raise InputError(unknown_name("reset option", name, known))


def parse_episodes(episodes: Any, shape: tuple[int, ...]) -> Array:
    """The reset option ``episode`` as whole numbers of a shape.

    Raises:
        ValueError: for what are none, or are below 0.
    """
    array = np.asarray(episodes)
    if array.shape != shape or array.dtype.kind not in "iu" or (array < 0).any():
        raise InputError(
            f"reset option `episode` must be whole numbers from 0, shape {shape}, got "
            f"{episodes!r:.60}"
        )
    return array


def parse_members(members: Any, shape: tuple[int, ...], count: int) -> Array:
    """The reset option ``mixture_index`` as whole numbers of a shape.

    Raises:
        ValueError: for what are none, or are no member of a mixture of ``count``.
    """
    array = np.asarray(members)
    whole = array.shape == shape and array.dtype.kind in "iu"
    if not whole or (array < 0).any() or (array >= count).any():
        raise InputError(
            f"reset option `mixture_index` must be whole numbers from 0 to {count - 1}, shape "
            f"{shape}, got {members!r}"
        )
    return array


def is_possible(setup: Setup, start: Components) -> Component:
    """Whether a start is finite and not faster than a motion may be; components in state order."""
    fine = within_bounds(*split_state(start))
    if setup.system.speed_limits is not None:
        for v, most in zip(start[1::2], setup.system.speed_limits, strict=True):
            fine = fine & (abs(v) <= most)
    return fine


def _fastest(setup: Setup) -> Components:
    """Largest magnitude of each velocity that a start may have."""
    limits = setup.system.speed_limits or (DIVERGENCE_SPEED,) * len(setup.plant.velocities)
    return tuple([np.minimum(limit, DIVERGENCE_SPEED) for limit in limits])


def parse_state(setup: Setup, state: Any) -> Components:
    """A start state as floats, in state order, from one in the order of ``env.unwrapped.state``.

    Raises:
        ValueError: if it has the wrong length, is not finite or is faster than a motion may be.
    """
    names = to_public_order(setup.task, np.array(state_names(setup.plant))).tolist()
    try:
        values = np.asarray(state, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise InputError(
            f"reset option `state` must be numbers ({', '.join(names)}), got {state!r:.60}"
        ) from None
    if values.shape != (len(names),):
        raise InputError(
            f"reset option `state` must be ({', '.join(names)}), shape ({len(names)},), "
            f"got shape {values.shape}"
        )
    return _check_size(setup, tuple(to_state_order(setup.task, values).tolist()))


def _check_size(setup: Setup, start: Components) -> Components:
    if not is_possible(setup, start):
        speeds = " and ".join(dict.fromkeys(f"{np.max(x):g}" for x in _fastest(setup)))
        given = tuple(to_public_order(setup.task, np.array(start)).tolist())
        raise InputError(
            f"a start state must be finite, with speeds up to {speeds}, got {given}; "
            "mend the reset option `state` or the start's bounds"
        )
    return start


def check_starts(setup: Setup) -> None:
    """Check that no start is faster than a motion may be.

    Tried are the slowest and fastest of a task whose starts are made of uniform numbers alone.

    Raises:
        ValueError: if one is, with the remedy.
    """
    if setup.settings.max_speed is None:
        return
    fastest = 0.0
    for number in (0.0, 0.5, 1.0):
        try:
            start = draw_with(setup, GivenNumbers(repeat(number)), {})
            limited = zip(start[1::2], setup.system.speed_limits or (), strict=True)
            fastest = max(fastest, *(abs(float(v)) for v, most in limited if np.all(most < np.inf)))
        except Exception:  # whatever a task of the user's own does with what is not a generator
            return
    if fastest > setup.settings.max_speed:
        raise InputError(
            f"`max_speed` {setup.settings.max_speed:g} is below the speed of starts, which is up "
            f"to {fastest:g}; give at least that"
        )


class GivenNumbers:
    """Stands for a generator whose numbers from [0, 1) are given.

    Args:
        numbers: floats, or arrays with one number per lane.

    Attributes:
        taken: how many were asked for.
    """

    def __init__(self, numbers: Iterator[Component]) -> None:
        self._numbers = numbers
        self.taken = 0

    def uniform(self, low: Any = 0.0, high: Any = 1.0, size: Any = None) -> Any:
        """As ``numpy.random.Generator.uniform``, with a list where that has a vector."""
        if size is None and np.ndim(low) == np.ndim(high) == 0:
            return self._between(low, high)
        count = max(np.size(low), np.size(high)) if size is None else int(np.prod(size))
        lows, highs = (np.broadcast_to(end, count).tolist() for end in (low, high))
        return [self._between(a, b) for a, b in zip(lows, highs, strict=True)]

    def _between(self, low: float, high: float) -> Component:
        self.taken += 1
        return low + (high - low) * next(self._numbers)


def numbers_per_start(setup: Setup) -> int | None:
    """How many uniform numbers make a start.

    Returns:
        None where a start is made of something else, as a task of the user's own may do, or where
        several starts cannot be made at once.
    """
    try:
        counting = GivenNumbers(repeat(0.5))
        draw_with(setup, counting, {})
        singly, ahead = np.random.default_rng(0), np.random.default_rng(0)
        one_by_one = [draw_with(setup, singly, {}) for _ in range(2)]
        numbers = ahead.random((2, counting.taken))
        together = draw_with(setup, GivenNumbers(iter(numbers.T)), {})
        same = np.array_equal(np.array(one_by_one), rows_of(together, 2))
    except Exception:  # whatever a task of the user's own does with what is not a generator
        return None
    return counting.taken if same else None


def draw_with(setup: Setup, generator: Any, options: Mapping[str, Any]) -> Any:
    """A start in state order, of whatever the task makes of the generator's numbers."""
    return setup.task.draw_start(generator, setup.settings.start, options)


AT_ONCE, MOST = 32, 1 << 16
"""Starts that are drawn at once: of a lane at most, and of all about."""


class Begun(NamedTuple):
    """Episodes at their starts; a component has one entry per episode, or is one for all."""

    values: tuple[Component, ...]
    """All components of the state, and of what a step takes from the call before."""
    energy: Array
    """J."""
    goal_since: Component
    """See :class:`.control_period.EnvState`."""
    observation: Array
    """Without noise, shape (episodes, n)."""


class LaneStarts:
    """Draws starts as each lane's own generator would, some ahead.

    A lane has two banks of starts: one is drawn anew when the other is begun.

    Args:
        setup: of the lanes.
        generators: one per lane, with PCG64; entries may be replaced after :meth:`forget`.
        size: numbers per start.
    """

    def __init__(self, setup: Setup, generators: list[np.random.Generator], size: int) -> None:
        lanes = len(generators)
        self._setup = setup
        self._generators = generators
        self._bank = max(1, min(AT_ONCE, MOST // lanes))
        self._numbers = np.zeros((2 * lanes * self._bank, size))
        self._first = 2 * self._bank * np.arange(lanes)
        self._banks = self._split_banks()
        self._taken = np.zeros(lanes, dtype=np.int64)
        self._drawn = np.zeros(lanes, dtype=np.int64)
        self._ready: _Ready | None = None

    def draw(self, lanes: Array, options: Mapping[str, Any]) -> Array:
        """Starts of some lanes, in state order, shape (len(lanes), n).

        Raises:
            ValueError: for one that is not possible.
        """
        starts = _starts_of(self._setup, self._numbers[self._places(lanes)], options)
        fine = is_possible(self._setup, tuple(starts.T))
        if not fine.all():
            _check_size(self._setup, tuple(starts[np.argmin(fine)].tolist()))
        return starts

    def begin(self, lanes: Array, first: Callable[[EnvState], Any]) -> Begun:
        """Episodes of some lanes, which are all alike, without options.

        Args:
            lanes: lane numbers.
            first: what a step takes from the call before, of the state that it is given.

        Raises:
            ValueError: for a start that is not possible.
        """
        places = self._places(lanes)
        if self._ready is None or self._ready.first != first:
            self._ready = _Ready(self._setup, first, self._numbers)
        return self._ready.at(places)

    def __getstate__(self) -> dict[str, Any]:
        """Without what is made of the rest, in part by a function that cannot be pickled."""
        return {**self.__dict__, "_ready": None, "_banks": None}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._banks = self._split_banks()

    def put_back(self) -> None:
        """Leave every generator as it would be had nothing been drawn ahead."""
        ahead = self._drawn - self._taken
        for lane in np.flatnonzero(ahead).tolist():
            source = self._generators[lane].bit_generator
            state = source.state
            source.advance(-int(ahead[lane]) * self._numbers.shape[1])  # type: ignore[attr-defined]
            source.state = {**state, "state": source.state["state"]}
        self._taken[:] = self._drawn[:] = 0

    def forget(self, lane: int) -> None:
        """Drop what was drawn ahead for a lane."""
        self._taken[lane] = self._drawn[lane] = 0

    def _places(self, lanes: Array) -> Array:
        """Where the next start of each of some lanes is, which is then taken."""
        taken = self._taken[lanes]
        if np.count_nonzero(taken == self._drawn[lanes]):
            self._draw_banks((self._drawn - self._taken <= self._bank).nonzero()[0])
        self._taken[lanes] = taken + 1
        return self._first[lanes] + taken % (2 * self._bank)

    def _split_banks(self) -> list[Array]:
        """The numbers of every bank, as parts of the array of all."""
        return [*self._numbers.reshape(2 * len(self._first), self._bank, self._numbers.shape[1])]

    def _draw_banks(self, lanes: Array) -> None:
        """Draw a bank of starts for some lanes that have one to be drawn."""
        banks = 2 * lanes + (self._drawn[lanes] // self._bank) % 2
        for lane, bank in zip(lanes.tolist(), banks.tolist(), strict=True):
            self._generators[lane].random(out=self._banks[bank])
        self._drawn[lanes] += self._bank
        if self._ready is not None:
            self._ready.make(banks, self._bank)


class _Ready:
    """Starts with all that follows from them.

    Args:
        setup: of the lanes.
        first: see :meth:`LaneStarts.begin`.
        numbers: of the starts, shape (starts, numbers per start), which change in place.
    """

    def __init__(self, setup: Setup, first: Callable[[EnvState], Any], numbers: Array) -> None:
        self.first = first
        self._setup = setup
        self._numbers = numbers
        tree, self._table, self._fine = self._prepare(numbers)
        self._all_fine = bool(self._fine.all())
        arrays, self._constants = _distinct(tree)
        self._observed = slice(len(arrays), self._table.shape[1])
        numbered = [*arrays, *[None] * (self._table.shape[1] - len(arrays)), *self._constants]
        places = {id(leaf): place for place, leaf in enumerate(numbered)}
        state: EnvState = tree[0]
        self._energy_and_goal = itemgetter(places[id(state.energy)], places[id(state.goal_since)])
        self._in_order = itemgetter(*(places[id(leaf)] for leaf in leaves_of(tree)))

    def at(self, places: Array) -> Begun:
        """Some of them."""
        if not (self._all_fine or self._fine[places].all()):
            starts = _starts_of(self._setup, self._numbers[places], {})
            _check_size(self._setup, tuple(starts[np.argmin(self._fine[places])].tolist()))
        rows = self._table.take(places, axis=0)
        values = [*rows.T.copy(), *self._constants]
        energy, goal_since = self._energy_and_goal(values)
        return Begun(self._in_order(values), energy, goal_since, rows[:, self._observed])

    def make(self, banks: Array, size: int) -> None:
        """Make those of some banks, of `size` starts each, anew."""
        numbers, table, fine = (
            array.reshape(len(array) // size, size, *array.shape[1:])
            for array in (self._numbers, self._table, self._fine)
        )
        _, prepared, fine_ones = self._prepare(numbers[banks].reshape(-1, numbers.shape[2]))
        table[banks] = prepared.reshape(len(banks), *table.shape[1:])
        fine[banks] = fine_ones.reshape(len(banks), size)
        self._all_fine = bool(self._fine.all())

    def _prepare(self, numbers: Array) -> tuple[Any, Array, Array]:
        """State and what a step takes; all its arrays, and observations; which are possible."""
        setup = self._setup
        start = tuple(_starts_of(setup, numbers, {}).T)
        q, v = split_state(start)
        with np.errstate(all="ignore"):
            state = initial_state(ARRAY, setup, setup.system.confine(ARRAY, q), v)
            observed = setup.task.observe(ARRAY, state.sensed_q, state.sensed_v)
            tree = state, self.first(state)
        table = rows_of((*_distinct(tree)[0], *observed), len(numbers))
        return tree, table, is_possible(setup, start)


def _starts_of(setup: Setup, numbers: Array, options: Mapping[str, Any]) -> Array:
    """Starts in state order, shape (starts, n), of uniform numbers, shape (starts, size)."""
    return rows_of(draw_with(setup, GivenNumbers(iter(numbers.T)), options), len(numbers))


def _distinct(tree: Any) -> tuple[list[Array], list[Component]]:
    """Arrays of a tree, each once, and numbers."""
    leaves = {id(leaf): leaf for leaf in leaves_of(tree)}.values()
    arrays = [leaf for leaf in leaves if isinstance(leaf, np.ndarray)]
    return arrays, [leaf for leaf in leaves if not isinstance(leaf, np.ndarray)]
