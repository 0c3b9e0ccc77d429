"""How many decisions of training it took until training episodes succeeded."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
import numpy.typing as npt

from integ_gym.eval.statistics import median_interval
from integ_gym.evidence.store import EvidenceStore

WINDOW = 100
"""Finished training episodes over which success is averaged."""

RATE = 0.9
"""Share of them that must succeed, with exploration, on what the policy is trained on."""

Array = npt.NDArray[Any]


def decisions_to_success(lengths: Array, successes: Array) -> float:
    """Decisions in the episodes up to the first where :data:`WINDOW` succeed often enough.

    Args:
        lengths: decisions of each episode, in the order in which they ended, shape (episodes,).
        successes: whether each succeeded, the same shape.

    Returns:
        A whole number; infinity if it never happens.
    """
    if len(lengths) < WINDOW:
        return math.inf
    succeeded = np.convolve(np.asarray(successes, dtype=np.int64), np.ones(WINDOW, int), "valid")
    reached = np.flatnonzero(succeeded >= RATE * WINDOW)
    return float(np.sum(lengths[: reached[0] + WINDOW])) if reached.size else math.inf


def training_costs(
    store: EvidenceStore, policies: Mapping[str, Sequence[str]]
) -> dict[str, dict[str, Any]]:
    """Cost of every row, from the records of its training episodes.

    Args:
        store: the panel's evidence.
        policies: policy ids by row.

    Returns:
        By row: decisions of every seed (null: not reached), how many reached it, and the median
        over seeds with its interval (null where it is not reached).
    """
    table = store.query(
        "SELECT policy_id, length, success FROM records WHERE phase = 'training' "
        "ORDER BY policy_id, episode_index"
    ).to_pydict()
    names = np.array(table["policy_id"], dtype=object)
    lengths, successes = (np.array(table[name]) for name in ("length", "success"))
    costs = {}
    for row, ids in policies.items():
        chosen = [names == policy for policy in ids]
        costs[row] = _cost([decisions_to_success(lengths[own], successes[own]) for own in chosen])
    return costs


def _cost(by_seed: Sequence[float]) -> dict[str, Any]:
    median = median_interval(by_seed)
    interval = {} if median is None else asdict(median)
    return {
        "window": WINDOW,
        "rate": RATE,
        "by_seed": [_known(value) for value in by_seed],
        "reached": int(np.isfinite(by_seed).sum()),
        "median": {name: _known(value) for name, value in interval.items()} or None,
    }


def _known(value: float) -> float | None:
    return value if math.isfinite(value) else None
