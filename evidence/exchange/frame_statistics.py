"""Minimum, maximum, mean and standard deviation of features, episode by episode and in all."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[Any]


class FrameStatistics:
    """Statistics of frames, of which those that are not known count as none."""

    def __init__(self) -> None:
        self._sums: dict[str, list[Array]] = {}

    def add(self, values: Mapping[str, Array]) -> dict[str, list[float]]:
        """Take an episode's frames; its own statistics, as ``stats/feature/name``.

        Args:
            values: by feature, shape (frames,) or (frames, size).
        """
        told: dict[str, list[float]] = {}
        for key, given in values.items():
            own = given.reshape(len(given), -1).astype(np.float64)
            sums = _sums(own)
            before = self._sums.get(key)
            self._sums[key] = sums if before is None else _together(before, sums)
            named = _named(sums)
            told |= {f"stats/{key}/{name}": value.tolist() for name, value in named.items()}
        return told

    def total(self) -> dict[str, dict[str, list[float | None]]]:
        """Statistics of all frames by feature, null where nothing is known."""
        return {
            key: {name: _finite(value) for name, value in _named(sums).items()}
            for key, sums in self._sums.items()
        }


def _sums(own: Array) -> list[Array]:
    """Number, frames, sum, sum of squares, minimum, maximum, of shape (size,)."""
    known = np.isfinite(own)
    zeroed = np.where(known, own, 0.0)
    return [
        known.sum(axis=0).astype(np.float64),
        np.array([float(len(own))]),
        zeroed.sum(axis=0),
        (zeroed**2).sum(axis=0),
        np.where(known, own, np.inf).min(axis=0),
        np.where(known, own, -np.inf).max(axis=0),
    ]


def _together(one: list[Array], other: list[Array]) -> list[Array]:
    added = [a + b for a, b in zip(one[:4], other[:4], strict=True)]
    return [*added, np.minimum(one[4], other[4]), np.maximum(one[5], other[5])]


def _named(sums: list[Array]) -> dict[str, Array]:
    number, frames, total, squares, least, most = sums
    unknown = number == 0.0
    mean = np.where(unknown, np.nan, total / np.maximum(number, 1.0))
    variance = np.maximum(squares / np.maximum(number, 1.0) - mean**2, 0.0)
    return {
        "min": np.where(unknown, np.nan, least),
        "max": np.where(unknown, np.nan, most),
        "mean": mean,
        "std": np.sqrt(variance),
        "count": frames,
    }


def _finite(values: Array) -> list[float | None]:
    return [x if np.isfinite(x) else None for x in values.tolist()]
