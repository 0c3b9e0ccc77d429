"""Observation statistics out of `vecnormalize.pkl`, a pickle of which nothing is executed."""

from __future__ import annotations

import math
from typing import Any

from ...policy.observation_statistics import ObservationStatistics
from ..error import PolicyFileError
from .pickles import ARRAYS, SPACES, StandIn, get_entries, read_pickle, to_array

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
    if not isinstance(saved, StandIn) or saved.name != _CLASS:
        raise PolicyFileError("holds no VecNormalize of stable-baselines3")
    entries = saved.entries
    if entries.get("norm_obs", True) is False:
        return None
    statistics = get_entries(entries.get("obs_rms"))
    if not {"mean", "var"} <= statistics.keys():
        raise PolicyFileError(
            "holds no statistics of one vector of observations; those of a dictionary are not read"
        )
    return ObservationStatistics(
        to_array(statistics["mean"]),
        to_array(statistics["var"]),
        _number(entries.get("epsilon")),
        _number(entries.get("clip_obs")),
    )


def _number(given: Any) -> float:
    value = float(to_array(given).item()) if isinstance(given, StandIn) else given
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise PolicyFileError("holds no `epsilon` or `clip_obs` that is a number")
    return float(value)
