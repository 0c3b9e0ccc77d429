"""The report's refinement ladders: success against the step, one small plot each."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final

from integ_gym.eval.formatting import step
from integ_gym.eval.panel_model import Estimate, Panel
from integ_gym.eval.report_data.ladders import Ladder, Rung, ladders_of

MARKERS: Final = ("circle", "square", "triangle", "diamond", "down", "plus", "cross")
"""Shapes that tell series apart where colour cannot."""

_PLOT: Final = (36.0, 12.0, 286.0, 176.0)  # left, top, right, bottom of a ladder's axes


def ladder_plots(panel: Panel) -> dict[str, Any] | None:
    """All ladders, None if the panel has none."""
    ladders = ladders_of(panel)
    if not ladders:
        return None
    found = dict.fromkeys(
        scheme for ladder in ladders for scheme in (*ladder.fixed, *ladder.following)
    )
    schemes = {scheme: place for place, scheme in enumerate(found)}
    return {
        "schemes": [
            {"name": name, "place": place % len(MARKERS), "shape": MARKERS[place % len(MARKERS)]}
            for name, place in schemes.items()
        ],
        "rows": [_ladder(ladder, schemes) for ladder in ladders],
        "follows": any(ladder.following for ladder in ladders),
        "plot": dict(zip(("left", "top", "right", "bottom"), _PLOT, strict=True)),
    }


def _ladder(ladder: Ladder, schemes: Mapping[str, int]) -> dict[str, Any]:
    truth = ladder.truth.success if ladder.truth is not None else None
    return {
        "row": ladder.row,
        "period": ladder.control_period,
        "truth": truth,
        "fixed": _ladder_plot(ladder.fixed, schemes, truth),
        "following": _ladder_plot(ladder.following, schemes, None),
    }


def _ladder_plot(
    rungs: Mapping[str, tuple[Rung, ...]], schemes: Mapping[str, int], truth: Estimate | None
) -> dict[str, Any] | None:
    """Geometry of one small plot in a frame of 300 by 210."""
    steps = sorted({rung.dt for line in rungs.values() for rung in line}, reverse=True)
    if not steps:
        return None
    ticks = steps if len(steps) < 6 else steps[:: math.ceil(len(steps) / 5)]
    return {
        "lines": [
            _ladder_line(scheme, line, schemes[scheme], len(schemes), steps)
            for scheme, line in rungs.items()
        ],
        "ticks": [(_ladder_x(dt, steps), step(dt)) for dt in ticks],
        "truth": None if truth is None else _ladder_y(truth.estimate),
        "values": [(rate, _ladder_y(rate)) for rate in (0.0, 0.25, 0.5, 0.75, 1.0)],
    }


def _ladder_line(
    scheme: str, line: Sequence[Rung], place: int, count: int, steps: Sequence[float]
) -> dict[str, Any]:
    """Points of one scheme, moved aside a little so that equal rates stay visible."""
    aside = (place - (count - 1) / 2.0) * 2.6
    points = []
    for rung in line:
        rate = rung.entry.success
        low, high = rate.ends
        points.append(
            {
                "x": round(_ladder_x(rung.dt, steps) + aside, 1),
                "y": _ladder_y(rate.estimate),
                "low": _ladder_y(low),
                "high": _ladder_y(high),
                "title": f"{scheme}, step {step(rung.dt)} s: success {rate}",
            }
        )
    return {
        "name": scheme,
        "place": place % len(MARKERS),
        "shape": MARKERS[place % len(MARKERS)],
        "points": points,
        "path": " ".join(f"{point['x']},{point['y']}" for point in points),
    }


def _ladder_x(dt: float, steps: Sequence[float]) -> float:
    """Coarse steps on the left, equal factors equally far apart."""
    left, _, right, _ = _PLOT
    span = math.log(steps[0] / steps[-1])
    share = math.log(steps[0] / dt) / span if span > 0.0 else 0.5
    return round(left + 22.0 + share * (right - left - 40.0), 1)


def _ladder_y(rate: float) -> float:
    _, top, _, bottom = _PLOT
    return round(bottom - min(max(rate, 0.0), 1.0) * (bottom - top), 1)
