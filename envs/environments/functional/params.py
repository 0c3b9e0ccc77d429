"""The values of a functional environment, which are not structure."""

from __future__ import annotations

from dataclasses import fields
from types import NoneType
from typing import Any, NamedTuple

import numpy as np

from ...arithmetic import Component, Components
from ...episode import Setup
from .starts import start_range


class Params(NamedTuple):
    """What may differ between environments that share one program.

    Every entry is a number, or an array that broadcasts against the lanes. Where ``substeps`` is an
    array, lanes with fewer wait for those with more. Given to a compiled function as an argument,
    it can take any value; the loop over sub-steps then also keeps XLA from computing a motion anew
    for everything that depends on it.
    """

    dt: Component
    """Integration step, s."""
    control_period: Component
    """Time between two decisions, s."""
    substeps: Component
    """Integration steps per decision, int32."""
    horizon: Component
    """Decisions until truncation, int32."""
    sensor: Component | None
    """Integration steps between two samples, int32; None: one sample per decision."""
    max_speed: Component | None
    """Clip on every velocity, rad/s or m/s; None: no clip."""
    observation_noise: Component
    """Standard deviation of each sensed state component, SI."""
    start_low: Components
    """Lower end of the start distribution, in state order, SI."""
    start_high: Components
    plant: dict[str, Component]
    """Numeric plant parameters, SI."""
    task: dict[str, Component]


def params_of(setup: Setup, dtype: str) -> Params:
    """A setup's own values, floats in the type ``dtype``."""
    settings, timing = setup.settings, setup.timing
    number = np.dtype(dtype).type
    low, high = start_range(setup)
    return Params(
        dt=number(timing.dt),
        control_period=number(timing.control_period),
        substeps=np.int32(timing.substeps),
        horizon=np.int32(timing.horizon),
        sensor=None if timing.sensor is None else np.int32(timing.sensor),
        max_speed=None if settings.max_speed is None else number(settings.max_speed),
        observation_noise=number(settings.observation_noise),
        start_low=tuple(number(x) for x in low),
        start_high=tuple(number(x) for x in high),
        plant={name: number(x) for name, x in _numbers(setup.plant).items()},
        task={name: number(x) for name, x in _numbers(setup.task).items()},
    )


def _numbers(part: Any) -> dict[str, Component]:
    """Numeric fields of a plant or task."""
    values = {f.name: getattr(part, f.name) for f in fields(part)}
    return {k: x for k, x in values.items() if not isinstance(x, (str, bool, NoneType))}
