"""Starts of many lanes at once, each drawn from its lane's own generator."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import repeat
from typing import Any

import numpy as np
import numpy.typing as npt

from integ_gym.envs.ops import Component
from integ_gym.envs.settings import Setup

Array = npt.NDArray[Any]

AHEAD = 32
"""Starts whose numbers are drawn at once."""


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
        lows, highs = np.ravel(low).tolist(), np.ravel(high).tolist()
        if size is None and np.ndim(low) == np.ndim(high) == 0:
            return self._between(lows[0], highs[0])
        count = max(len(lows), len(highs)) if size is None else int(np.prod(size))
        ends = zip(_repeated(lows, count), _repeated(highs, count), strict=True)
        return [self._between(a, b) for a, b in ends]

    def _between(self, low: float, high: float) -> Component:
        self.taken += 1
        return low + (high - low) * next(self._numbers)


def _repeated(values: list[float], count: int) -> list[float]:
    return values * count if len(values) == 1 else values


def numbers_per_start(setup: Setup) -> int | None:
    """How many uniform numbers make a start.

    Returns:
        None where a start is made of something else, as a task of the user's own may do, or where
        several starts cannot be made at once.
    """
    try:
        counting = GivenNumbers(repeat(0.5))
        _make(setup, counting, {})
        singly, ahead = np.random.default_rng(0), np.random.default_rng(0)
        one_by_one = [_make(setup, singly, {}) for _ in range(2)]
        numbers = ahead.random((2, counting.taken))
        together = _make(setup, GivenNumbers(iter(numbers.T)), {})
        same = np.array_equal(np.array(one_by_one), _table(together, 2))
    except Exception:  # whatever a task of the user's own does with what is not a generator
        return None
    return counting.taken if same else None


class LaneStarts:
    """Draws starts as each lane's own generator would, some ahead.

    Args:
        setup: of the lanes.
        generators: one per lane; entries may be replaced after :meth:`forget`.
        size: numbers per start.
    """

    def __init__(self, setup: Setup, generators: list[np.random.Generator], size: int) -> None:
        self._setup = setup
        self._generators = generators
        self._numbers = np.empty((len(generators), AHEAD, size))
        self._next = np.full(len(generators), AHEAD)
        self._before: list[Any] = [None] * len(generators)

    def draw(self, lanes: Array, options: Mapping[str, Any]) -> Array:
        """Starts of some lanes, in state order, shape (len(lanes), n)."""
        for lane in lanes[self._next[lanes] == AHEAD].tolist():
            generator = self._generators[lane]
            self._before[lane] = generator.bit_generator.state
            generator.random(out=self._numbers[lane])
            self._next[lane] = 0
        numbers = self._numbers[lanes, self._next[lanes]]
        self._next[lanes] += 1
        return _table(_make(self._setup, GivenNumbers(iter(numbers.T)), options), lanes.size)

    def put_back(self) -> None:
        """Leave every generator as it would be had nothing been drawn ahead."""
        for lane in np.flatnonzero(self._next < AHEAD).tolist():
            generator = self._generators[lane]
            generator.bit_generator.state = self._before[lane]
            generator.random((self._next[lane], self._numbers.shape[2]))
        self._next[:] = AHEAD

    def forget(self, lane: int) -> None:
        """Drop what was drawn ahead for a lane."""
        self._next[lane] = AHEAD


def _make(setup: Setup, generator: Any, options: Mapping[str, Any]) -> Any:
    return setup.task.draw_start(generator, setup.settings.start, options)


def _table(start: Any, count: int) -> Array:
    """Components, each one number or one per lane, as rows of shape (count, n)."""
    rows = np.empty((count, len(start)))
    for column, values in enumerate(start):
        rows[:, column] = values
    return rows
