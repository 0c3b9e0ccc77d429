"""Observation statistics of a `VecNormalize`, from its own file or from JSON."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np

from integ_gym.support.files import read_bounded

from ....policy.observation_statistics import ObservationStatistics
from ...error import PolicyFileError
from ..pickles import looks_pickled
from ..vec_normalize import read_vec_normalize
from . import limits
from .data import Json, json_object

_DEFAULTS = {"epsilon": 1e-8, "clip_obs": 10.0}
"""Of `VecNormalize`, and of CleanRL's scripts."""

GivenStatistics: TypeAlias = (
    str | os.PathLike[str] | Mapping[str, Any] | ObservationStatistics | Literal[False] | None
)
"""Statistics as people give them: a file, ``{"mean": …, "var": …}``, or False where the policy
learned from observations as they are; None: nothing is said."""


def observation_statistics_of(given: GivenStatistics) -> ObservationStatistics | None:
    """Statistics that were given in one of these ways; None where observations are not normalized.

    Raises:
        PolicyFileError: in one sentence, for a file that cannot be read, or wrong values.
    """
    if given is None or given is False or isinstance(given, ObservationStatistics):
        return given or None
    if not isinstance(given, Mapping):
        return read_observation_statistics(given)
    try:
        lists = {name: np.ravel(given[name]).tolist() for name in ("mean", "var") if name in given}
        return _statistics({**given, **lists})
    except ValueError as error:
        raise PolicyFileError(
            f'obs_stats: {error}; give {{"mean": …, "var": …}} with one number per observation'
        ) from error


def read_observation_statistics(path: str | os.PathLike[str]) -> ObservationStatistics | None:
    """Read observation statistics; None where observations are not normalized.

    The file is the `vecnormalize.pkl` that `VecNormalize.save(path)` wrote, of which nothing is
    executed; or JSON with the keys of
    `{"mean": [...], "var": [...], "epsilon": 1e-8, "clip_obs": 10.0}`, which are `obs_rms.mean`,
    `obs_rms.var`, `epsilon` and `clip_obs` of a `VecNormalize`; the last two are these numbers
    where they are left out.

    Raises:
        PolicyFileError: in one sentence, if the file is missing, malformed or has wrong values.
    """
    file = Path(path)
    remedy = (
        'give the file of VecNormalize.save(path), or write {"mean": [...], "var": [...], '
        '"epsilon": 1e-8, "clip_obs": 10.0} with the numbers of the VecNormalize used in training'
    )
    try:
        content = _read_small_file(file)
        if looks_pickled(content):
            return read_vec_normalize(content)
        return _statistics(json_object(content, "the file {}"))
    except ValueError as error:
        raise PolicyFileError(f"{file}: {error}; {remedy}") from error


def _read_small_file(file: Path) -> bytes:
    """The bytes of a file of at most `limits.MAX_JSON_BYTES`."""
    try:
        return read_bounded(file, limits.MAX_JSON_BYTES)
    except OSError as error:
        raise PolicyFileError(f"cannot be opened ({error.strerror})") from error


def _statistics(fields: Json) -> ObservationStatistics:
    """Statistics from parsed JSON; raises ValueError with what is wrong."""
    if not {"mean", "var"} <= set(fields) <= {"mean", "var", *_DEFAULTS}:
        raise ValueError(
            "expected the keys mean, var and perhaps epsilon, clip_obs, got "
            f"{', '.join(sorted(map(str, fields)))}"
        )
    fields = {**_DEFAULTS, **fields}
    for name in ("mean", "var"):
        if not isinstance(fields[name], list) or not all(map(_is_number, fields[name])):
            raise ValueError(f"'{name}' must be a list of finite numbers")
    for name in ("epsilon", "clip_obs"):
        if not _is_number(fields[name]):
            raise ValueError(f"'{name}' must be a finite number, got {fields[name]!r}")
    return ObservationStatistics(**fields)


def _is_number(value: object) -> bool:
    """Whether a JSON value is a number that a float can hold."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    try:
        return math.isfinite(value)
    except OverflowError:
        return False
