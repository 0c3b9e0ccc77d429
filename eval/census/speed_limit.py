"""Where a subject cuts its speed, and whether the cut speed moves it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from integ_gym.envs import numerics

from .identify import Found
from .subjects.subject import Sample, Transition

CUT = 1e-4
"""Relative difference between a velocity and the map's that rounding cannot explain."""


@dataclass(frozen=True)
class SpeedLimit:
    """What was found of a speed limit.

    Attributes:
        fastest: highest speed with which a control period began, rad/s or m/s.
        limit: the speed to which all faster ones are cut; None: they are not.
        moves_by: whether positions advance with the `cut` or the `uncut` velocity; None without a
            limit, and where the map advances them with the earlier one.
        slowed: whether it is slower than the map at high speeds, and not by a limit.
    """

    fastest: float
    limit: float | None = None
    moves_by: Literal["cut", "uncut"] | None = None
    slowed: bool = False


def find_speed_limit(sample: Sample, found: Found) -> SpeedLimit:
    """Compare fast control periods with the map that was found at lower speeds."""
    fastest = max(abs(x) for (_, v, _), _ in sample.transitions for x in v)
    cut = [one for one in sample.transitions if _is_cut(sample, found, one)]
    if not cut:
        return SpeedLimit(fastest)
    speeds = [max(map(abs, one.end[1])) for one in cut]
    limit = max(speeds)
    if limit - min(speeds) > CUT * limit:
        return SpeedLimit(fastest, slowed=True)
    by_cut, by_uncut = (_largest(sample, found, cut, most) for most in (limit, None))
    if math.isclose(by_cut, by_uncut, abs_tol=CUT):
        return SpeedLimit(fastest, limit)
    return SpeedLimit(fastest, limit, "cut" if by_cut < by_uncut else "uncut")


def _is_cut(sample: Sample, found: Found, one: Transition) -> bool:
    """Whether it ends slower than the map says."""
    _, v = numerics.mapped(found.map, sample.plant, found.dt, found.substeps, one.case)
    return any(
        math.isfinite(x) and abs(x) - abs(got) > CUT * (1.0 + abs(x))
        for x, got in zip(v, one.end[1], strict=True)
    )


def _largest(
    sample: Sample, found: Found, transitions: Sequence[Transition], limit: float | None
) -> float:
    """Largest error of the positions."""
    errors = []
    for case, (end_q, _) in transitions:
        q, _ = numerics.mapped(found.map, sample.plant, found.dt, found.substeps, case, limit)
        errors.append(numerics.largest_error((end_q, ()), (q, ())))
    return max(errors)
