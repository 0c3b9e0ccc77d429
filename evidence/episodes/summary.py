"""Summaries of many episodes at once, from their rows."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from ..schema import SUMMARY_FIELDS
from .episode_rows import EpisodeRows
from .layout import Layout

Array = npt.NDArray[Any]

_TYPES = {"bool": np.bool_, "int64": np.int64, "string": np.int64}
"""By a field's kind; of a string, its place among the choices."""


def summarise(layout: Layout, rows: Array, counts: Array) -> dict[str, Array]:
    """One value per episode for every field that the rows decide.

    Args:
        layout: what the entries of a row are.
        rows: rows of whole episodes one after the other, shape (entries, sum of counts).
        counts: rows of each episode, at least 2, shape (episodes,).

    Returns:
        Arrays of shape (episodes,), by field name, ``solver_status`` as a code; ``time``,
        ``goal_reached``, ``goal_left`` and ``goal_since`` beside them. NaN where there is no value.
    """
    episodes = EpisodeRows(layout, rows, counts)
    values = {
        field.name: field.origin.value(episodes).astype(_TYPES.get(field.kind, np.float64))
        for field in SUMMARY_FIELDS
        if field.origin is not None and field.origin.of == "rows"
    }
    return {
        **values,
        "time": episodes.last("time"),
        "goal_reached": episodes.goal_reached(),
        "goal_left": episodes.goal_left(),
        "goal_since": episodes.goal_since(),
    }
