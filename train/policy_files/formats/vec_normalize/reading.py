"""Observation statistics out of a pickled `VecNormalize`."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ....policy.observation_statistics import ObservationStatistics
from ...error import PolicyFileError
from .inert_pickle import Name, Note, entries, parse_pickle

_CLASS = Name("stable_baselines3.common.vec_env.vec_normalize", "VecNormalize")
_ARRAYS = ("numpy.core.multiarray", "numpy._core.multiarray")
_BUFFERS = ("numpy.core.numeric", "numpy._core.numeric")
_ENCODE = Name("_codecs", "encode")
_NUMBERS = ("f4", "f8", "i4", "i8")


def read_vec_normalize(content: bytes) -> ObservationStatistics | None:
    """What a `VecNormalize` does to observations; None where it leaves them as they are.

    Args:
        content: of the file that ``VecNormalize.save(path)`` wrote.

    Raises:
        PolicyFileError: for another file, or values that cannot be.
    """
    saved = parse_pickle(content)
    if not isinstance(saved, Note) or saved.maker != _CLASS:
        raise PolicyFileError("holds no VecNormalize of stable-baselines3")
    held = entries(saved)
    if held.get("norm_obs", True) is False:
        return None
    statistics = entries(held.get("obs_rms"))
    if not {"mean", "var"} <= statistics.keys():
        raise PolicyFileError(
            "holds no statistics of one vector of observations; those of a dictionary are not read"
        )
    return ObservationStatistics(
        _array(statistics["mean"]),
        _array(statistics["var"]),
        _number(held.get("epsilon")),
        _number(held.get("clip_obs")),
    )


def _number(given: Any) -> float:
    value = float(_array(given).item()) if isinstance(given, Note) else given
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise PolicyFileError("holds no `epsilon` or `clip_obs` that is a number")
    return float(value)


def pickled_kind(content: bytes) -> str:
    """Type of the numbers of one pickled array, such as `f4`.

    Raises:
        PolicyFileError: for what is no pickled array of numbers.
    """
    try:
        return _kind(_stored(parse_pickle(content))[1])
    except PolicyFileError:
        raise
    except Exception as error:  # damaged bytes can fail in any way
        raise PolicyFileError("holds no array of numbers") from error


def _array(note: Any) -> NDArray[np.float64]:
    """An array or scalar of numbers, from what its pickle notes."""
    return _numbers(*_stored(note))


def _stored(note: Any) -> tuple[Any, Any, Any, Any]:
    """Bytes, type, shape and order of an array or scalar of numbers."""
    if isinstance(note, Note) and isinstance(note.maker, Name):
        maker, given = note.maker, note.arguments
        if maker.module in _ARRAYS and maker.name == "_reconstruct" and len(note.state) == 1:
            _, shape, dtype, fortran, content = note.state[0]
            return content, dtype, shape, "F" if fortran else "C"
        if maker.module in _ARRAYS and maker.name == "scalar":
            return given[1], given[0], (), "C"
        if maker.module in _BUFFERS and maker.name == "_frombuffer":
            content, dtype, shape, order = given
            return content, dtype, shape, order
    raise PolicyFileError("holds statistics that are no arrays of numbers")


def _kind(dtype: Any) -> str:
    kind = dtype.arguments[0] if isinstance(dtype, Note) else None
    if kind not in _NUMBERS:
        raise PolicyFileError("holds statistics that are no arrays of numbers")
    return str(kind)


def _bytes(content: Any) -> bytes:
    """Bytes, which protocol 2 writes as text to be encoded."""
    if isinstance(content, Note) and content.maker == _ENCODE:
        text, encoding = content.arguments
        if isinstance(text, str) and encoding == "latin1":
            return text.encode("latin1")
    if not isinstance(content, bytes | bytearray):
        raise PolicyFileError("holds statistics whose numbers are not stored as bytes")
    return bytes(content)


def _numbers(content: Any, dtype: Any, shape: Any, order: Any) -> NDArray[np.float64]:
    kind, byte_order = _kind(dtype), dtype.state[0][1] if dtype.state else "<"
    if byte_order not in ("<", ">", "=") or order not in ("C", "F"):
        raise PolicyFileError("holds statistics that are no arrays of numbers")
    flat = np.frombuffer(_bytes(content), dtype=f"{byte_order}{kind}")
    return flat.reshape(shape, order=order).astype(np.float64)
