"""Lanes: arrays of one value per environment, and parameters that differ between lanes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import fields, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from integ_gym.support.errors import InputError

from .ops.ops import Component, map_leaves
from .settings import Setup

Array = npt.NDArray[Any]


def blank(tree: Any, num_envs: int) -> Any:
    """Zeros of shape (num_envs,) in place of the components of ``tree``."""
    return map_leaves(lambda x: np.zeros(num_envs, np.asarray(x).dtype), tree)


def take(tree: Any, lanes: Array) -> Any:
    """``tree``, whose components are of shape (num_envs,) or one for all, of some lanes."""
    return map_leaves(lambda x: x[lanes] if np.ndim(x) else x, tree)


def put(tree: Any, lanes: Array, values: Any, num_envs: int) -> Any:
    """``tree`` as fresh arrays of shape (num_envs,), with ``values`` in some lanes."""

    def merged(old: Component, new: Component) -> Array:
        array = old.copy() if isinstance(old, np.ndarray) else np.full(num_envs, old)
        array[lanes] = new
        return array

    return map_leaves(merged, tree, values)


def varied(setup: Setup) -> dict[str, Array]:
    """Parameters of plant and task that differ between lanes."""
    return _arrays(setup.plant) | _arrays(setup.task)


def of_lanes(setup: Setup, lanes: Array) -> Setup:
    """``setup`` with the parameters of some lanes."""
    plant, task = _part_of(setup.plant, lanes), _part_of(setup.task, lanes)
    return setup.with_values(plant, task, setup.timing, setup.system.max_speed)


def check_lanes(setup: Setup, lanes: int) -> None:
    """Check that parameters fit the number of lanes.

    Raises:
        ValueError: otherwise.
    """
    if lanes < 1:
        raise InputError(f"`num_envs` must be 1 or above, got {lanes}")
    for name, value in varied(setup).items():
        if value.shape != (lanes,):
            raise InputError(
                f"`{name}` must be a number or one value per environment, shape ({lanes},), "
                f"got shape {value.shape}"
            )


def lane_seeds(seed: int | Sequence[int | None] | None, lanes: int) -> Sequence[int | None]:
    """One seed per lane.

    Raises:
        ValueError: for a list of another length.
    """
    if seed is None:
        return [None] * lanes
    if isinstance(seed, (int, np.integer)):
        return [int(seed) + lane for lane in range(lanes)]
    if len(seed) != lanes:
        raise InputError(f"`seed` must be an int or one per lane ({lanes}), got {len(seed)}")
    return seed


def _part_of(part: Any, lanes: Array) -> Any:
    return replace(part, **{name: x[lanes] for name, x in _arrays(part).items()})


def _arrays(part: Any) -> dict[str, Array]:
    names = {f.name for f in fields(part)}
    return {k: x for k, x in vars(part).items() if k in names and isinstance(x, np.ndarray)}


def as_floats(values: Any, large: bool = True) -> Array:
    """A copy of actions as floats.

    Args:
        values: numbers.
        large: whether a whole number that a float cannot hold is infinite.

    Raises:
        ValueError: for what is no number.
    """
    array = np.asarray(values)
    kind = array.dtype.kind
    if kind not in _KINDS or (kind == "O" and any(value is None for value in array.flat)):
        raise InputError(f"actions must be numbers, got {values!r:.60}")
    try:
        floats: Array = np.array(array, dtype=np.float64)
    except TypeError:
        raise InputError(f"actions must be numbers, got {values!r:.60}") from None
    except OverflowError:
        if not large:
            raise InputError(f"an action is larger than any number, got {values!r:.60}") from None
        floats = np.asarray(np.frompyfunc(_as_float, 1, 1)(array), dtype=np.float64)
    return floats


_KINDS = "biufO"
"""Of arrays that hold numbers: truth values, whole and real numbers, objects."""


def _as_float(value: Any) -> float:
    try:
        return float(value)
    except OverflowError:
        return math.inf if value > 0 else -math.inf
