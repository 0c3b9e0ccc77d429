"""`info` of the vector environment: arrays of shape (num_envs,) with Gymnasium's masks."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from integ_gym.envs.info import BLANK
from integ_gym.envs.lanes import Array, full
from integ_gym.envs.ops import Component
from integ_gym.envs.transition import STATUS_NAMES, EnvState

Info = dict[str, Array]

_STATUS = np.array(STATUS_NAMES, dtype=object)
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
        status: solver status where no step has been taken.
    """

    def __init__(self, lanes: int, status: str) -> None:
        self._lanes = lanes
        self._blank = {**BLANK, "solver_status": status}
        self._constants: dict[Any, Array] = {}
        self.everyone = np.ones(lanes, dtype=bool)
        self.everyone.flags.writeable = False

    def nothing(self) -> Info:
        """Arrays to be filled in, in which nothing is told."""
        return {name: self._empty(type(value)) for name, value in BLANK.items()}

    def of_step(self, told: dict[str, Any]) -> Info:
        """`info` of what a step has told, and its results; see :data:`ArrayStep`."""
        told["solver_status"] = _STATUS[told["solver_status"]]
        return {
            name: value if isinstance(value, np.ndarray) else self._alike(name, value)
            for name, value in told.items()
        }

    def begin(self, info: Info, lanes: Array, state: EnvState) -> None:
        """Tell about a reset of some lanes instead."""
        for name, blank in self._blank.items():
            values = info[name]
            if not values.flags.writeable:
                if values[0] == blank:
                    continue
                values = info[name] = values.copy()
            values[lanes] = blank
        info["energy"][lanes] = state.energy[lanes]
        info["goal_since"][lanes] = state.goal_since[lanes]

    def _empty(self, kind: type) -> Array:
        if kind is str:
            return np.empty(self._lanes, dtype=object)
        return np.zeros(self._lanes, dtype=_DTYPES[kind])

    def _alike(self, name: str, value: Component) -> Array:
        """One number for all lanes."""
        dtype = _DTYPES[type(BLANK[name])]
        if type(value) not in _DTYPES:
            return full(value, self._lanes, dtype)
        if (name, value) not in self._constants:
            array = full(value, self._lanes, dtype)
            array.flags.writeable = False
            self._constants[name, value] = array
        return self._constants[name, value]


def masked(info: dict[str, Any], mask: Array) -> dict[str, Any]:
    """``info`` with Gymnasium's `_key` masks, one array for all."""
    return {**info, **dict.fromkeys(_mask_names(tuple(info)), mask)}


@lru_cache(maxsize=16)
def _mask_names(names: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(f"_{name}" for name in names)


def kept(info: Info, mask: Array) -> Info:
    """Copies of ``info`` with nothing outside ``mask``."""
    copies = {}
    for name, values in info.items():
        nothing = np.empty if values.dtype == object else np.zeros
        copies[name] = nothing(values.shape, dtype=values.dtype)
        copies[name][mask] = values[mask]
    return copies
