"""Times that must be whole multiples of one another, and how they count."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

TOLERANCE = 1e-9
"""Relative tolerance of a whole multiple."""

MOST = 1e9
"""No time is a larger multiple of another."""


FINEST_DIVISION = 1000
"""Parts of the reference's step that are tried to fit latencies and sensor periods."""


def is_multiple(value: float, unit: float) -> bool:
    """Whether ``value`` is a whole multiple of ``unit``, 0 included, within the tolerance."""
    ratio = value / unit
    return abs(ratio - round(ratio)) <= TOLERANCE * max(1, round(ratio))


def dividing_step(arguments: Mapping[str, Any]) -> float:
    """The largest whole part of ``dt`` that divides the action latency and the sensor period.

    The reference may take any step, for its result does not depend on it.
    """
    dt = float(arguments["dt"])
    delays = [arguments.get(name) for name in ("action_latency", "sensor_period")]
    parts = (dt / count for count in range(1, FINEST_DIVISION + 1))
    fits = (part for part in parts if all(is_multiple(float(x), part) for x in delays if x))
    return next(fits, dt)


def whole_multiple(name: str, value: float, unit_name: str, unit: float, least: int = 1) -> int:
    """How many ``unit`` make up ``value``.

    Raises:
        ValueError: if ``value`` is no whole multiple of ``unit``, naming the nearest valid values.
    """
    ratio = value / unit
    if ratio > MOST:
        raise ValueError(
            f"`{name}`={value:.12g} s is more than {MOST:.0e} times `{unit_name}`={unit:.12g} s; "
            f"give a longer `{unit_name}`"
        )
    count = round(ratio)
    if count >= least and is_multiple(value, unit):
        return count
    below = max(least, math.floor(ratio))
    nearest = " or ".join(f"{n * unit:.12g}" for n in (below, below + 1))
    kept = "" if value <= 0.0 else f"; or keep it, with `{unit_name}` {_parts(value, ratio)} s"
    raise ValueError(
        f"`{name}`={value:.12g} s is not a whole multiple of `{unit_name}`={unit:.12g} s; "
        f"nearest valid: {nearest} s{kept}"
    )


def check_divides(name: str, value: float, whole_name: str, whole: float) -> None:
    """Check that a time that is given is a whole part of one that cannot be chosen.

    Raises:
        ValueError: if ``whole`` is no whole multiple of ``value``, naming the nearest valid values.
    """
    ratio = whole / value
    if ratio <= MOST and (round(ratio) < 1 or not is_multiple(whole, value)):
        raise ValueError(
            f"`{name}`={value:.12g} s does not divide {whole_name} of {whole:.12g} s into whole "
            f"steps; nearest valid: {_parts(whole, ratio)} s"
        )


def _parts(whole: float, ratio: float) -> str:
    """The whole parts of a time that are nearest to the one that goes into it ``ratio`` times."""
    below = math.floor(ratio)
    return " or ".join(f"{whole / n:.12g}" for n in (below + 1, below) if n)


def _horizon(duration: float, period: float) -> int:
    """Decisions until truncation."""
    if duration / period > MOST:
        raise ValueError(
            f"`duration`={duration:.12g} s is more than {MOST:.0e} control periods of "
            f"{period:.12g} s; give a shorter one"
        )
    return max(1, math.ceil(duration / period * (1.0 - TOLERANCE)))


def _check_within(name: str, value: float, duration: float) -> None:
    if value > duration * (1.0 + TOLERANCE):
        raise ValueError(
            f"`{name}`={value:.12g} s is longer than an episode, `duration`={duration:.12g} s; all "
            "times are in seconds"
        )


@dataclass(frozen=True)
class Timing:
    """Rates of one environment, in seconds and in sub-steps of ``dt``.

    Attributes:
        dt: integration step, s.
        control_period: time between two decisions, s.
        substeps: integration steps per decision.
        latency: action latency in integration steps.
        sensor: integration steps between two sensor samples, or None for one per decision.
        horizon: decisions until truncation.
    """

    dt: float
    control_period: float
    substeps: int
    latency: int
    sensor: int | None
    horizon: int

    @classmethod
    def of(
        cls,
        dt: float,
        control_period: float | None,
        action_latency: float,
        sensor_period: float | None,
        duration: float,
    ) -> Timing:
        """Check the times against each other and count them.

        Raises:
            ValueError: if one of them is no whole multiple of ``dt``, or if an episode has not one
                whole control period or ends before the first command acts.
        """
        period = dt if control_period is None else control_period
        _check_within("control_period" if control_period else "dt", period, duration)
        _check_within("action_latency", action_latency, duration)
        return cls(
            dt=dt,
            control_period=period,
            substeps=whole_multiple("control_period", period, "dt", dt),
            latency=whole_multiple("action_latency", action_latency, "dt", dt, least=0),
            sensor=None
            if sensor_period is None
            else whole_multiple("sensor_period", sensor_period, "dt", dt),
            horizon=_horizon(duration, period),
        )

    @property
    def delay(self) -> tuple[int, int]:
        """Latency as (whole decisions, sub-steps beyond them)."""
        return divmod(self.latency, self.substeps)

    @property
    def memory(self) -> int:
        """Past commands to keep: those still under way, and the last one to hold."""
        periods, rest = self.delay
        return max(1, periods + (1 if rest else 0))
