"""Observation statistics of a `VecNormalize`, from its own file or from JSON."""

from __future__ import annotations

import math
import os
from pathlib import Path

from integ_gym.support import read_bounded

from ....policy import ObservationStatistics
from ...error import PolicyFileError
from ..vec_normalize import looks_pickled, read_vec_normalize
from . import limits
from .data import Json, json_object


def read_observation_statistics(path: str | os.PathLike[str]) -> ObservationStatistics | None:
    """Read observation statistics; None where observations are not normalized.

    The file is the `vecnormalize.pkl` that `VecNormalize.save(path)` wrote, of which nothing is
    executed; or JSON with exactly the keys of
    `{"mean": [...], "var": [...], "epsilon": 1e-8, "clip_obs": 10.0}`, which are `obs_rms.mean`,
    `obs_rms.var`, `epsilon` and `clip_obs` of a `VecNormalize`.

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
    expected = {"mean", "var", "epsilon", "clip_obs"}
    if set(fields) != expected:
        raise ValueError(
            f"expected the keys {', '.join(sorted(expected))}, got {', '.join(sorted(fields))}"
        )
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
