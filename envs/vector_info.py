"""`info` of the vector environment: arrays of shape (num_envs,) with Gymnasium's masks.

The solver's status is a code until it is told: :meth:`LaneInfo.told`.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from .lanes import Array
from .ops.ops import Component
from .transition import BLANK, STATUS_NAMES

Info = dict[str, Array]

_WORDS = np.array(STATUS_NAMES, dtype=object)
_UNTOLD = np.array(None, dtype=object)
_DTYPES: dict[type, npt.DTypeLike] = {
    float: np.float64,
    bool: np.bool_,
    int: np.int64,
    str: np.object_,
}


class LaneInfo:
    """Makes `info` of all lanes.

    Its arrays are made anew at every step, but for those that hold one value for all lanes: these
    are read-only, and the same at all steps.

    Args:
        lanes: how many.
        status: code of the solver's status where no step has been taken.
    """

    def __init__(self, lanes: int, status: int) -> None:
        self._lanes = lanes
        self._blank = {**BLANK, "solver_status": status}
        self._constants: dict[Any, Array] = {}
        self._alike: Mapping[str, Any] = {}
        self._alike_arrays: Info = {}
        self._masks_of_everyone: dict[tuple[str, ...], Info] = {}
        self._rewritten = dict(self._blank)
        self.everyone = np.ones(lanes, dtype=bool)
        self.everyone.flags.writeable = False

    def __reduce__(self) -> tuple[Any, ...]:
        """Made anew where it is copied or pickled: arrays would no longer be read-only."""
        return LaneInfo, (self._lanes, self._blank["solver_status"])

    def nothing(self) -> Info:
        """Arrays to be filled in, in which nothing is told."""
        return {n: np.zeros(self._lanes, _DTYPES[type(value)]) for n, value in BLANK.items()}

    def of_step(self, told: dict[str, Any], alike: Mapping[str, Any]) -> Info:
        """`info` of what a step has told, and of what is alike; see :class:`.steps.LanesStep`."""
        if alike is not self._alike:
            self._note(alike)
        info = {**self._alike_arrays, **told}
        for name, value in told.items():
            if type(value) is not np.ndarray:
                info[name] = self._one_for_all(name, value, type(BLANK[name]))
        return info

    def result(self, name: str, told: dict[str, Any], alike: Mapping[str, Any]) -> Array:
        """A result of a step, taken out of what it has told; an array of its own."""
        value = told.pop(name, None)
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
            name: self._one_for_all(name, value, type(BLANK[name]))
            for name, value in alike.items()
            if name in BLANK
        }
        self._rewritten = {
            name: blank
            for name, blank in self._blank.items()
            if name not in alike or alike[name] != blank
        }

    def told(self, info: Info, mask: Array) -> dict[str, Array]:
        """What users see: the solver's status in words, and Gymnasium's `_key` masks.

        Args:
            info: of all lanes.
            mask: lanes that are told about; one array for all keys.
        """
        words = self._words(info["solver_status"])
        if mask is not self.everyone:
            words = np.where(mask, words, _UNTOLD)
        return {**info, "solver_status": words, **self._masks(tuple(info), mask)}

    def _masks(self, names: tuple[str, ...], mask: Array) -> Info:
        if mask is not self.everyone:
            return dict.fromkeys(_mask_names(names), mask)
        if names not in self._masks_of_everyone:
            self._masks_of_everyone[names] = dict.fromkeys(_mask_names(names), mask)
        return self._masks_of_everyone[names]

    def _words(self, codes: Array) -> Array:
        if codes.flags.writeable:
            return _WORDS[codes]
        return self._one_for_all("solver_status", STATUS_NAMES[codes[0]], str)

    def _one_for_all(self, name: str, value: Any, kind: type) -> Array:
        dtype = _DTYPES[kind]
        if type(value) not in _DTYPES:
            return np.full(self._lanes, value, dtype)
        if (name, value) not in self._constants:
            array = np.full(self._lanes, value, dtype)
            array.flags.writeable = False
            self._constants[name, value] = array
        return self._constants[name, value]


@lru_cache(maxsize=16)
def _mask_names(names: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(f"_{name}" for name in names)


def kept(info: Info, mask: Array) -> Info:
    """Copies of ``info`` with nothing outside ``mask``."""
    return {name: np.where(mask, values, values.dtype.type()) for name, values in info.items()}
