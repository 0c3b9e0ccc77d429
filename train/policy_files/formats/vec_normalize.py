"""Observation statistics out of `vecnormalize.pkl`, a pickle of which nothing is executed."""

from __future__ import annotations

import math
from typing import Any

from ...policy.observation_statistics import ObservationStatistics
from ..error import PolicyFileError
from .pickles import ARRAYS, SPACES, Held, array_of, entries_of, read_pickle

_CLASS = ("stable_baselines3.common.vec_env.vec_normalize", "VecNormalize")
_RUNNING_MEAN = ("stable_baselines3.common.running_mean_std", "RunningMeanStd")
_ALLOWED = ARRAYS | SPACES | {_CLASS, _RUNNING_MEAN}


def read_vec_normalize(content: bytes) -> ObservationStatistics | None:
    """What a `VecNormalize` does to observations; None where it leaves them as they are.

    Args:
        content: of the file that ``VecNormalize.save(path)`` wrote.

    Raises:
        PolicyFileError: for another file, or values that cannot be.
    """
    saved = read_pickle(content, _ALLOWED)
    if not isinstance(saved, Held) or saved.name != _CLASS:
        raise PolicyFileError("holds no VecNormalize of stable-baselines3")
    held = saved.entries
    if held.get("norm_obs", True) is False:
        return None
    statistics = entries_of(held.get("obs_rms"))
    if not {"mean", "var"} <= statistics.keys():
        raise PolicyFileError(
            "holds no statistics of one vector of observations; those of a dictionary are not read"
        )
    return ObservationStatistics(
        array_of(statistics["mean"]),
        array_of(statistics["var"]),
        _number(held.get("epsilon")),
        _number(held.get("clip_obs")),
    )


def _number(given: Any) -> float:
    value = float(array_of(given).item()) if isinstance(given, Held) else given
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise PolicyFileError("holds no `epsilon` or `clip_obs` that is a number")
    return float(value)
