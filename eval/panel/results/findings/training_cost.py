"""How many decisions of training it took until training episodes succeeded."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from integ_gym.evidence.store import EvidenceStore

from ....statistics import Interval, median_interval
from ...model.conclusions import Median, TrainingCost

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
) -> dict[str, TrainingCost]:
    """Cost of every row, from the records of its training episodes.

    Args:
        store: the panel's evidence.
        policies: policy ids by row.

    Returns:
        By row.
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


def _cost(by_seed: Sequence[float]) -> TrainingCost:
    return TrainingCost(
        window=WINDOW,
        rate=RATE,
        by_seed=tuple(_known(value) for value in by_seed),
        reached=int(np.isfinite(by_seed).sum()),
        median=_median(median_interval(by_seed)),
    )


def _median(found: Interval | None) -> Median | None:
    if found is None:
        return None
    estimate, low, high = (_known(value) for value in (found.estimate, found.low, found.high))
    return Median(estimate=estimate, low=low, high=high, level=found.level)


def _known(value: float) -> float | None:
    return value if math.isfinite(value) else None
