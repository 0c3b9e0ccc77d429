"""Summaries of many episodes at once, from their rows."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from integ_gym.evidence.layout import STATUS, Layout

Array = npt.NDArray[Any]

_TOTALS = {
    "return": "reward",
    "work_total": "actuator_work",
    "dissipated_total": "dissipated",
    "clip_loss_total": "clip_loss",
    "energy_residual_total": "energy_residual",
    "contact_loss_total": "contact_loss",
}

_MAXIMA = {
    "penetration_max": "penetration",
    "constraint_violation_max": "constraint_violation",
}

_WHOLE_MAXIMA = {"solver_iterations_max": "solver_iterations", "status_code": STATUS}


def summarise(layout: Layout, rows: Array, counts: Array) -> dict[str, Array]:
    """One value per episode for every field that the rows decide.

    Args:
        layout: what the entries of a row are.
        rows: rows of whole episodes one after the other, shape (entries, sum of counts).
        counts: rows of each episode, at least 2, shape (episodes,).

    Returns:
        Arrays of shape (episodes,), by field name; ``time``, ``goal_reached``, ``goal_left``,
        ``goal_since`` and ``status_code`` beside them. NaN where there is no value.
    """
    ends = np.cumsum(counts)
    starts = ends - counts
    columns = dict(zip(layout.names, rows, strict=True))
    first = {name: column[starts] for name, column in columns.items()}
    last = {name: column[ends - 1] for name, column in columns.items()}
    steps = counts - 1
    missing = np.full(len(counts), np.nan)

    def reduced(function: np.ufunc, column: Array) -> Array:
        values: Array = function.reduceat(column, starts)
        return values

    def each(function: np.ufunc, sources: dict[str, str]) -> dict[str, Array]:
        return {
            name: reduced(function, columns[source]) if source in layout else missing
            for name, source in sources.items()
        }

    fallback = columns["fallback_used"]
    success = last["success"] > 0.0
    goal = _goal_times(columns["time"], columns["goal_since"], starts)
    return {
        **each(np.add, _TOTALS),
        **each(np.maximum, _MAXIMA),
        **{name: x.astype(np.int64) for name, x in each(np.maximum, _WHOLE_MAXIMA).items()},
        **goal,
        "goal_since": np.where(last["goal_since"] >= 0.0, last["goal_since"], np.nan),
        "time": last["time"],
        "length": steps,
        "success": success,
        "time_to_success": np.where(success, last["goal_since"], np.nan),
        "terminated": last["terminated"] > 0.0,
        "truncated": last["truncated"] > 0.0,
        "saturated_share": reduced(np.add, columns["saturated"]) / steps,
        "fallback_count": reduced(np.add, fallback).astype(np.int64),
        "recovery_count": reduced(np.add, _falls(fallback, starts)).astype(np.int64),
        "energy_start": first["energy"],
        "energy_end": last["energy"],
        "energy_residual_abs_total": reduced(np.add, np.abs(columns["energy_residual"])),
        "solver_iterations_mean": reduced(np.add, columns["solver_iterations"]) / steps,
        "initial_state": rows[layout.places(layout.state), starts].T,
    }


def _falls(flag: Array, starts: Array) -> Array:
    """1.0 in each row whose flag is off right after a row of the same episode with it on."""
    falls = np.zeros_like(flag)
    falls[1:] = (flag[:-1] > 0.0) & (flag[1:] <= 0.0)
    falls[starts] = 0.0
    return falls


def _goal_times(time: Array, since: Array, starts: Array) -> dict[str, Array]:
    """First time at the goal and last time of leaving it, s."""
    there = since >= 0.0
    left = _falls(there.astype(np.float64), starts) > 0.0
    reached = np.minimum.reduceat(np.where(there, time, np.inf), starts)
    leaving = np.maximum.reduceat(np.where(left, time, -np.inf), starts)
    return {
        "goal_reached": np.where(np.isfinite(reached), reached, np.nan),
        "goal_left": np.where(np.isfinite(leaving), leaving, np.nan),
    }
