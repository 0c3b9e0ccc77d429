"""Starts of many lanes, each from its lane's own generator, made many at a time."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from operator import itemgetter
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ..arithmetic.array_ops import ARRAY, rows_of
from ..arithmetic.ops import Component
from ..arithmetic.trees import leaves_of
from ..plants.interface import split_state
from .control_period import EnvState, initial_state
from .settings import Setup
from .starts import GivenNumbers, checked_state, made_start, possible

Array = npt.NDArray[Any]

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
        self._banks = self._parted()
        self._taken = np.zeros(lanes, dtype=np.int64)
        self._drawn = np.zeros(lanes, dtype=np.int64)
        self._ready: _Ready | None = None

    def draw(self, lanes: Array, options: Mapping[str, Any]) -> Array:
        """Starts of some lanes, in state order, shape (len(lanes), n).

        Raises:
            ValueError: for one that is not possible.
        """
        starts = _starts_of(self._setup, self._numbers[self._places(lanes)], options)
        fine = possible(self._setup, tuple(starts.T))
        if not fine.all():
            checked_state(self._setup, starts[np.argmin(fine)])
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
        self._banks = self._parted()

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
        places: Array = self._first[lanes] + taken % (2 * self._bank)
        return places

    def _parted(self) -> list[Array]:
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
        tree, self._table, self._fine = self._made(numbers)
        self._all_fine = bool(self._fine.all())
        arrays, self._constants = _distinct(tree)
        self._observed = slice(len(arrays), self._table.shape[1])
        numbered = [*arrays, *[None] * (self._table.shape[1] - len(arrays)), *self._constants]
        places = {id(leaf): place for place, leaf in enumerate(numbered)}
        state: EnvState = tree[0]
        self._told = itemgetter(places[id(state.energy)], places[id(state.goal_since)])
        self._in_order = itemgetter(*(places[id(leaf)] for leaf in leaves_of(tree)))

    def at(self, places: Array) -> Begun:
        """Some of them."""
        if not (self._all_fine or self._fine[places].all()):
            starts = _starts_of(self._setup, self._numbers[places], {})
            checked_state(self._setup, starts[np.argmin(self._fine[places])])
        rows = self._table.take(places, axis=0)
        values = [*rows.T.copy(), *self._constants]
        energy, goal_since = self._told(values)
        return Begun(self._in_order(values), energy, goal_since, rows[:, self._observed])

    def make(self, banks: Array, size: int) -> None:
        """Make those of some banks, of `size` starts each, anew."""
        numbers, table, fine = (
            array.reshape(len(array) // size, size, *array.shape[1:])
            for array in (self._numbers, self._table, self._fine)
        )
        _, made, possible_ones = self._made(_in_a_row(numbers[banks]))
        table[banks] = made.reshape(len(banks), *table.shape[1:])
        fine[banks] = possible_ones.reshape(len(banks), size)
        self._all_fine = bool(self._fine.all())

    def _made(self, numbers: Array) -> tuple[Any, Array, Array]:
        """State and what a step takes; all its arrays, and observations; which are possible."""
        setup = self._setup
        start = tuple(_starts_of(setup, numbers, {}).T)
        q, v = split_state(start)
        with np.errstate(all="ignore"):
            state = initial_state(ARRAY, setup, setup.system.confined(ARRAY, q), v)
            observed = setup.task.observe(ARRAY, state.sensed_q, state.sensed_v)
            tree = state, self.first(state)
        table = rows_of((*_distinct(tree)[0], *observed), len(numbers))
        return tree, table, possible(setup, start)


def _starts_of(setup: Setup, numbers: Array, options: Mapping[str, Any]) -> Array:
    """Starts in state order, shape (starts, n), of uniform numbers, shape (starts, size)."""
    return rows_of(made_start(setup, GivenNumbers(iter(numbers.T)), options), len(numbers))


def _in_a_row(numbers: Array) -> Array:
    """Numbers of the starts of all banks, bank by bank."""
    banks, starts, size = numbers.shape
    return numbers.reshape(banks * starts, size)


def _distinct(tree: Any) -> tuple[list[Array], list[Component]]:
    """Arrays of a tree, each once, and numbers."""
    leaves = {id(leaf): leaf for leaf in leaves_of(tree)}.values()
    arrays = [leaf for leaf in leaves if isinstance(leaf, np.ndarray)]
    return arrays, [leaf for leaf in leaves if not isinstance(leaf, np.ndarray)]
