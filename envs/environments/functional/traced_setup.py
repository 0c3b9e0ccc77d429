"""Plant, task, timing and engine of an environment whose values may be traced."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

from ...episode import Setup, Timing
from .params import Params
from .structure import OPTIONAL, lacks


def traced_setup(setup: Setup, params: Params) -> Setup:
    """``setup`` with these values."""
    plant = replace(setup.plant, **params.plant)  # type: ignore[type-var]
    task = replace(setup.task, **params.task)  # type: ignore[type-var]
    vars(plant).update({part: None for part in OPTIONAL if lacks(setup.plant, part)})
    _fill_caches(plant)
    _fill_caches(task)
    timing = _TracedTiming(
        dt=params.dt,
        control_period=params.control_period,
        substeps=params.substeps,
        latency=setup.timing.latency,
        sensor=params.sensor,
        horizon=params.horizon,
        known_delay=setup.timing.delay,
    )
    return setup.with_values(plant, task, timing, params.max_speed)


@dataclass(frozen=True)
class _TracedTiming(Timing):
    """Rates whose delay is known while those in seconds and sub-steps may be traced."""

    known_delay: tuple[int, int] = (0, 0)

    @property
    def delay(self) -> tuple[int, int]:
        """Latency as (whole decisions, sub-steps beyond them)."""
        return self.known_delay


def _fill_caches(part: Any) -> None:
    """Compute cached properties now, so that none is first computed, and kept, inside a loop."""
    for owner in type(part).__mro__:
        for name, value in vars(owner).items():
            if isinstance(value, cached_property):
                getattr(part, name)
