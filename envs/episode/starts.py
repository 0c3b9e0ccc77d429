"""Starts: drawn or given, checked; of many lanes at once, each from its lane's own generator."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import repeat
from typing import Any

import numpy as np
import numpy.typing as npt

from integ_gym.support.parameters import unknown_name

from ..arithmetic.array_ops import rows_of
from ..arithmetic.ops import FLOAT32_MAX, Component, Components
from ..plants.interface import state_names
from .control_period import top_speed
from .settings import Setup

Array = npt.NDArray[Any]


NOISE, MEMBER = 0x4E01, 0x4E02
"""What streams beside that of the starts are for; apart from the numbers that ``spawn`` gives."""


def stream_of_episode(starts: np.random.Generator, use: int, episode: int) -> np.random.Generator:
    """A generator for one episode, beside the one that draws starts.

    What is drawn from it leaves the starts as they are, however long an episode lasts, and can be
    drawn again without the episodes before.

    Args:
        starts: whose seed it has; nothing is drawn from it.
        use: `NOISE` or `MEMBER`.
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
        return checked_state(setup, options["state"])
    start = setup.task.draw_start(rng, setup.settings.start, options)
    return _checked_size(setup, tuple([float(x) for x in start]))


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
            raise ValueError(unknown_name("reset option", name, known))


def checked_episodes(episodes: Any, shape: tuple[int, ...]) -> Array:
    """The reset option ``episode`` as whole numbers of a shape.

    Raises:
        ValueError: for what are none, or are below 0.
    """
    array = np.asarray(episodes)
    if array.shape != shape or array.dtype.kind not in "iu" or (array < 0).any():
        raise ValueError(
            f"reset option `episode` must be whole numbers from 0, shape {shape}, got "
            f"{episodes!r:.60}"
        )
    return array


def possible(setup: Setup, start: Components) -> Component:
    """Whether a start is finite and not faster than a motion may be; components in state order."""
    fastest = top_speed(setup)
    fine: Component = True
    for x in start[0::2]:
        fine = fine & (abs(x) <= FLOAT32_MAX)
    for v in start[1::2]:
        fine = fine & (abs(v) <= fastest)
    return fine


def checked_state(setup: Setup, state: Any) -> Components:
    """A start state as floats.

    Raises:
        ValueError: if it has the wrong length, is not finite or is faster than a motion may be.
    """
    names = state_names(setup.plant)
    try:
        values = np.asarray(state, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise ValueError(
            f"reset option `state` must be numbers ({', '.join(names)}), got {state!r:.60}"
        ) from None
    if values.shape != (len(names),):
        raise ValueError(
            f"reset option `state` must be ({', '.join(names)}), shape ({len(names)},), "
            f"got shape {values.shape}"
        )
    return _checked_size(setup, tuple(values.tolist()))


def _checked_size(setup: Setup, start: Components) -> Components:
    if not possible(setup, start):
        raise ValueError(
            f"a start state must be finite, with speeds up to {top_speed(setup):g}, got {start}; "
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
            start = made_start(setup, GivenNumbers(repeat(number)), {})
            fastest = max(fastest, *(abs(float(v)) for v in start[1::2]))
        except Exception:  # whatever a task of the user's own does with what is not a generator
            return
    if fastest > setup.settings.max_speed:
        raise ValueError(
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
        made_start(setup, counting, {})
        singly, ahead = np.random.default_rng(0), np.random.default_rng(0)
        one_by_one = [made_start(setup, singly, {}) for _ in range(2)]
        numbers = ahead.random((2, counting.taken))
        together = made_start(setup, GivenNumbers(iter(numbers.T)), {})
        same = np.array_equal(np.array(one_by_one), rows_of(together, 2))
    except Exception:  # whatever a task of the user's own does with what is not a generator
        return None
    return counting.taken if same else None


def made_start(setup: Setup, generator: Any, options: Mapping[str, Any]) -> Any:
    """A start in state order, of whatever the task makes of the generator's numbers."""
    return setup.task.draw_start(generator, setup.settings.start, options)
