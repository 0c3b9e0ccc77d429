"""`info` of the vector environment: arrays of shape (num_envs,) with Gymnasium's masks.

The solver's status is a code until it is told: :meth:`LaneInfo.told`.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from ..episode import BLANK, STATUS_NAMES, EnvState
from .lanes import Array

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
        self.everyone = np.ones(lanes, dtype=bool)
        self.everyone.flags.writeable = False

    def nothing(self) -> Info:
        """Arrays to be filled in, in which nothing is told."""
        return {n: np.zeros(self._lanes, _DTYPES[type(value)]) for n, value in BLANK.items()}

    def of_step(self, told: dict[str, Any]) -> Info:
        """`info` of what a step has told, and its results; see :data:`ArrayStep`."""
        return {
            name: value
            if isinstance(value, np.ndarray)
            else self._alike(name, value, type(BLANK[name]))
            for name, value in told.items()
        }

    def begin(self, info: Info, lanes: Array, state: EnvState) -> None:
        """Tell about a reset of some lanes instead, whose components have one entry per reset."""
        for name, blank in self._blank.items():
            values = info[name]
            if not values.flags.writeable:
                if values[0] == blank:
                    continue
                values = info[name] = values.copy()
            values[lanes] = blank
        info["energy"][lanes] = state.energy
        info["goal_since"][lanes] = state.goal_since

    def told(self, info: Info, mask: Array) -> dict[str, Array]:
        """What users see: the solver's status in words, and Gymnasium's `_key` masks.

        Args:
            info: of all lanes.
            mask: lanes that are told about; one array for all keys.
        """
        words = self._words(info["solver_status"])
        if mask is not self.everyone:
            words = np.where(mask, words, _UNTOLD)
        return {**info, "solver_status": words, **dict.fromkeys(_mask_names(tuple(info)), mask)}

    def _words(self, codes: Array) -> Array:
        if codes.flags.writeable:
            return _WORDS[codes]
        return self._alike("solver_status", STATUS_NAMES[codes[0]], str)

    def _alike(self, name: str, value: Any, kind: type) -> Array:
        """One value for all lanes."""
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
