"""Which known map, with which step, a subject's control period is made of."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from integ_gym.envs import numerics
from integ_gym.envs.engines.maps import map_names
from integ_gym.envs.registries import TRUTH

from .subjects.subject import Sample, State, Statement

SUBSTEPS = (1, 2, 3, 4, 5, 8, 10, 20)
"""Integration steps in one control period that are tried, beside the stated number."""

SCREENED = 3
"""Control periods of each sample by which unlikely candidates are sorted out."""

CORRECTIONS = 8
"""Gauss-Newton corrections of the length of a control period, at most."""


@dataclass(frozen=True)
class Found:
    """What a control period is made of.

    Attributes:
        map: the known map that is nearest.
        equal_maps: all maps that it cannot be told from.
        substeps: steps of it in one control period.
        dt: of one step, s.
        defect: largest error of one control period against it, relative to 1 + |value|.
        identified: whether that is no more than the arithmetic.
        runner_up: the nearest map that it can be told from, and its defect.
        truth_defect: largest error of one control period against the exact solution over the
            stated time.
    """

    map: str
    equal_maps: tuple[str, ...]
    substeps: int
    dt: float
    defect: float
    identified: bool
    runner_up: tuple[str, float]
    truth_defect: float

    @property
    def control_period(self) -> float:
        """Time that one control period takes, s."""
        return self.substeps * self.dt


def identify(samples: Sequence[Sample], stated: Statement, width: int) -> Found:
    """Search for the map, the number of steps and, failing that, the length of a control period.

    Args:
        samples: control periods.
        stated: tried first.
        width: bits of the floats in which they were seen.
    """
    limit = numerics.IDENTICAL[width]
    found = _compared(samples, stated, stated.substeps, stated.control_period, limit)
    if found.identified:
        return found
    for count, length, names in _candidates(samples, stated):
        if min(_screened(samples, name, count, length) for name in names) <= limit:
            other = _compared(samples, stated, count, length, limit)
            if other.identified:
                return other
    return found


def _candidates(
    samples: Sequence[Sample], stated: Statement
) -> Iterator[tuple[int, float, Sequence[str]]]:
    """Numbers of steps, lengths of a control period in seconds, and maps for which to try them."""
    others = [n for n in SUBSTEPS if n != stated.substeps]
    for count in others:
        yield count, stated.control_period, map_names()
    for count in (stated.substeps, *others):
        for name in map_names():
            fitted = _fitted_period(samples, name, count)
            if fitted is not None:
                yield count, fitted, (name,)


def _compared(
    samples: Sequence[Sample], stated: Statement, count: int, period: float, limit: float
) -> Found:
    """The nearest map in ``count`` steps over ``period``."""
    names = (*map_names(), TRUTH)
    defects = dict.fromkeys(names, 0.0)
    for sample in samples:
        found = numerics.match(sample.step, sample.plant, period, sample.cases, names, count)
        defects = {name: max(defects[name], found.defects[name]) for name in names}
    ranked = sorted(names, key=lambda n: (max(defects[n], limit), n != stated.map))
    equal = tuple(n for n in ranked if defects[n] <= limit) or ranked[:1]
    other, first = next(n for n in ranked if n not in equal), samples[0]
    return Found(
        map=ranked[0],
        equal_maps=tuple(equal),
        substeps=count,
        dt=period / count,
        defect=defects[ranked[0]],
        identified=defects[ranked[0]] <= limit,
        runner_up=(other, defects[other]),
        truth_defect=numerics.match(
            first.step, first.plant, stated.control_period, first.cases, (TRUTH,)
        ).defect,
    )


def _fitted_period(samples: Sequence[Sample], name: str, count: int) -> float | None:
    """The length of a control period with which a map is nearest, s; None where it fails."""
    period, before = _travelled_time(samples), math.inf
    for _ in range(CORRECTIONS):
        here = _residuals(samples, name, count, period)
        ahead = _residuals(samples, name, count, period * (1.0 + 1e-6))
        slopes = (ahead - here) / (period * 1e-6)
        if not (np.isfinite(slopes).all() and slopes.any()):
            return None
        if np.linalg.norm(here) > 0.5 * before:
            return period
        before = float(np.linalg.norm(here))
        period -= float(slopes @ here / (slopes @ slopes))
        if not 0.0 < period < math.inf:
            return None
    return period


def _screened(samples: Sequence[Sample], name: str, count: int, period: float) -> float:
    """Largest error of a map over a few control periods."""
    return max(numerics.largest_error(*both) for both in _few(samples, name, count, period))


def _travelled_time(samples: Sequence[Sample]) -> float:
    """Displacement over mean velocity: the length of a control period to its second order, s."""
    pairs = [
        (after - before, 0.5 * (slow + fast))
        for sample in samples
        for (q, v, _), (end_q, end_v) in sample.transitions
        for before, after, slow, fast in zip(q, end_q, v, end_v, strict=True)
    ]
    moved, speed = np.array(pairs).T
    return abs(float(moved @ speed / (speed @ speed)))


def _residuals(samples: Sequence[Sample], name: str, count: int, period: float) -> np.ndarray:
    few = _few(samples, name, count, period)
    return np.concatenate([np.concatenate(got) - np.concatenate(end) for got, end in few])


def _few(
    samples: Sequence[Sample], name: str, count: int, period: float
) -> Iterator[tuple[State, State]]:
    """Where a map ends, and where the subject did, after a few control periods of each sample."""
    for sample in samples:
        for case, end in sample.transitions[:SCREENED]:
            yield numerics.mapped(name, sample.plant, period / count, count, case), end
