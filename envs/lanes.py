"""Lanes: arrays of one value per environment, parameters that differ between them, `info`."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt
from gymnasium.vector import AutoresetMode, VectorEnv

from integ_gym.support.errors import InputError

from .ops.ops import Array, Component, map_leaves
from .settings import Mixture, Setup
from .transition import STATUS_NAMES


def zeros_like(tree: Any, num_envs: int) -> Any:
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


def lane_parameters(setup: Setup) -> dict[str, Array]:
    """Parameters of plant and task that differ between lanes."""
    return _arrays(setup.plant) | _arrays(setup.task)


def setup_of_lanes(setup: Setup, lanes: Array) -> Setup:
    """``setup`` with the parameters of some lanes."""
    plant, task = part_of(setup.plant, lanes), part_of(setup.task, lanes)
    return setup.with_values(plant, task, setup.timing, setup.system.max_speed)


def check_lanes(setup: Setup, lanes: int) -> None:
    """Check that parameters fit the number of lanes.

    Raises:
        ValueError: otherwise.
    """
    if lanes < 1:
        raise InputError(f"`num_envs` must be 1 or above, got {lanes}")
    for name, value in lane_parameters(setup).items():
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


def part_of(part: Any, lanes: Any) -> Any:
    """A plant or task with the parameters of some lanes, or of one."""
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


Info = dict[str, Array]

_WORDS = np.array(STATUS_NAMES, dtype=object)
_UNTOLD = np.array(None, dtype=object)
DTYPES: dict[type, npt.DTypeLike] = {
    float: np.float64,
    bool: np.bool_,
    int: np.int64,
    str: np.object_,
}
"""By the type of what one lane tells, what an array of all lanes holds."""


class LaneInfo:
    """Makes `info` of all lanes.

    Its arrays are made anew at every step, but for those that hold one value for all lanes: these
    are read-only, and the same at all steps.

    Args:
        lanes: how many.
        blank: what a reset reports, but for what depends on the start.
    """

    def __init__(self, lanes: int, blank: Mapping[str, Any]) -> None:
        self._lanes = lanes
        self._blank = dict(blank)
        self._constants: dict[Any, Array] = {}
        self._alike: Mapping[str, Any] = {}
        self._alike_arrays: Info = {}
        self._masks_of_everyone: dict[tuple[str, ...], Info] = {}
        self._rewritten = dict(self._blank)
        self.everyone = np.ones(lanes, dtype=bool)
        self.everyone.flags.writeable = False

    def __reduce__(self) -> tuple[Any, ...]:
        """Made anew where it is copied or pickled: arrays would no longer be read-only."""
        return LaneInfo, (self._lanes, self._blank)

    def nothing(self) -> Info:
        """Arrays to be filled in, with nothing in them."""
        return {n: np.zeros(self._lanes, DTYPES[type(value)]) for n, value in self._blank.items()}

    def of_step(self, step_values: dict[str, Any], alike: Mapping[str, Any]) -> Info:
        """`info` of what a step reported, and of what is alike; see :class:`.steps.LanesStep`."""
        if alike is not self._alike:
            self._note(alike)
        info = {**self._alike_arrays, **step_values}
        for name, value in step_values.items():
            if type(value) is not np.ndarray:
                info[name] = self._one_for_all(name, value, type(self._blank[name]))
        return info

    def result(self, name: str, step_values: dict[str, Any], alike: Mapping[str, Any]) -> Array:
        """A result of a step, taken out of what it has reported; an array of its own."""
        value = step_values.pop(name, None)
        if isinstance(value, np.ndarray):
            return value
        value = alike[name] if value is None else value
        return self._one_for_all(name, value, type(value)).copy()

    def begin(self, info: Info, lanes: Array, energy: Array, goal_since: Component) -> None:
        """Tell about a reset of some lanes instead, with their energy and `goal_since`."""
        for name, blank in self._rewritten.items():
            values = info[name]
            if not values.flags.writeable:
                if values[0] == blank:
                    continue
                values = info[name] = values.copy()
            values[lanes] = blank
        info["energy"][lanes] = energy
        info["goal_since"][lanes] = goal_since

    def _note(self, alike: Mapping[str, Any]) -> None:
        """Remember what is alike in all lanes, and which of it a reset leaves as it is."""
        self._alike = alike
        self._alike_arrays = {
            name: self._one_for_all(name, value, type(self._blank[name]))
            for name, value in alike.items()
            if name in self._blank
        }
        self._rewritten = {
            name: blank
            for name, blank in self._blank.items()
            if name not in alike or alike[name] != blank
        }

    def with_masks(self, info: Info, mask: Array) -> dict[str, Array]:
        """What users see: the solver's status in words, and Gymnasium's `_key` masks.

        Args:
            info: of all lanes.
            mask: lanes that the info is about; one array for all keys.
        """
        codes, names = info["solver_status"], tuple(info)
        if codes.flags.writeable:
            words = _WORDS[codes]
        else:
            words = self._one_for_all("solver_status", STATUS_NAMES[codes[0]], str)
        if mask is not self.everyone:
            words = np.where(mask, words, _UNTOLD)
            return {**info, "solver_status": words, **dict.fromkeys(mask_names(names), mask)}
        if names not in self._masks_of_everyone:
            self._masks_of_everyone[names] = dict.fromkeys(mask_names(names), mask)
        return {**info, "solver_status": words, **self._masks_of_everyone[names]}

    def _one_for_all(self, name: str, value: Any, kind: type) -> Array:
        dtype = DTYPES[kind]
        if type(value) not in DTYPES:
            return np.full(self._lanes, value, dtype)
        if (name, value) not in self._constants:
            array = np.full(self._lanes, value, dtype)
            array.flags.writeable = False
            self._constants[name, value] = array
        return self._constants[name, value]


@lru_cache(maxsize=16)
def mask_names(names: tuple[str, ...]) -> tuple[str, ...]:
    """Gymnasium's names of the masks of entries of ``info``."""
    return tuple(f"_{name}" for name in names)


def mask_outside(info: Info, mask: Array) -> Info:
    """Copies of ``info`` with nothing outside ``mask``."""
    return {name: np.where(mask, values, values.dtype.type()) for name, values in info.items()}


class DiscretizedVectorEnv(VectorEnv[Any, Any, Any]):
    """A vector environment of which evidence can be recorded.

    Attributes:
        mixture: the discretizations that its lanes run on; one where it is no mixture.
        setups: what the lanes are made of: the mixture's.
        autoreset_mode: when a lane that has ended is reset.
        state_components: true states in state order (q0, v0, q1, v1, …), component by component,
            each of shape (num_envs,); they hold until the next step.
        status_codes: the solver's status in every lane's last step, as a code of `STATUS_NAMES`;
            read-only. Of a lane that was reset in place of a step, that of the reset.
        final_state: with ``SAME_STEP``, :attr:`state` before the last step's resets.
    """

    mixture: Mixture
    setups: tuple[Any, ...]
    autoreset_mode: AutoresetMode
    state_components: Any
    status_codes: npt.NDArray[np.int64]
    final_state: npt.NDArray[np.float64]

    @property
    def state(self) -> npt.NDArray[np.float64]:
        """True states, each as the single environment's, SI units, shape (num_envs, n)."""
        return np.stack(self.state_components, axis=1)
