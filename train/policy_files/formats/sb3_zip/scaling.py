"""Whether a model learned from observations that `VecNormalize` scaled, as its file shows.

SB3 saves what its environment gave last, `_last_obs`, and what that was before it was scaled,
`_last_original_obs`, as pickles, of which nothing is executed here.
"""

from __future__ import annotations

import base64
from typing import Any

from ...error import PolicyFileError
from ..pickles import read_number_type
from .data import Json

_OFF_POLICY = "buffer_size"
"""Algorithms with a replay buffer keep raw observations outside `VecNormalize` as well."""


def learned_scaled(data: Json) -> bool:
    """Whether the model of this `data` was trained inside `VecNormalize`, as far as that shows.

    Scaled observations are float32, which tells where the environment's are float64. Where these
    are float32 too, on-policy algorithms keep raw ones inside `VecNormalize` alone, be it one with
    ``norm_obs=False``, and of off-policy algorithms it does not show.
    """
    raw = data.get("_last_original_obs")
    if raw is None:
        return False
    before, after = _kind(raw), _kind(data.get("_last_obs"))
    if before and after and before != after:
        return True
    return _OFF_POLICY not in data and before != "f8"


def _kind(described: Any) -> str | None:
    """Type of a saved array's numbers, such as `f4`; None for what is no such array."""
    text = described.get(":serialized:") if isinstance(described, dict) else None
    try:
        return read_number_type(base64.b64decode(str(text), validate=True))
    except (PolicyFileError, ValueError):
        return None
