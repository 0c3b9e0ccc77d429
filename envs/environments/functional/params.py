"""What decides the program of a functional environment, and the values that it takes."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import cached_property
from itertools import repeat
from types import NoneType
from typing import Any, NamedTuple

import numpy as np

from ...arithmetic.ops import Component, Components
from ...episode.settings import Setup
from ...episode.starts import GivenNumbers
from ...episode.timing import Timing
from ...plants.interface import Plant

OPTIONAL = ("stops", "dry_friction")
"""Parts of a plant that it may lack, which decides the program."""


@dataclass(frozen=True)
class Structure:
    """What decides the program: environments with equal structure can share a compiled one.

    Attributes:
        env_id: environment.
        dtype: float type of the physics.
        choices: arguments that are no numbers, and the presence of those that may be None.
        delay: action latency as (whole decisions, sub-steps beyond them).
    """

    env_id: str
    dtype: str
    choices: tuple[tuple[str, Any], ...]
    delay: tuple[int, int]


def structure_of(env_id: str, setup: Setup, dtype: str) -> Structure:
    """What a setup decides of the program, with floats in the type ``dtype``."""
    choices = {
        name: value
        for name, value in setup.arguments().items()
        if isinstance(value, (str, bool)) and name != "start"
    }
    present = {
        "sensor_period": setup.timing.sensor is not None,
        "max_speed": setup.settings.max_speed is not None,
        "observation_noise": setup.settings.observation_noise > 0.0,
        **{part: not lacks(setup.plant, part) for part in OPTIONAL},
    }
    return Structure(env_id, dtype, tuple({**choices, **present}.items()), setup.timing.delay)


def lacks(plant: Plant, part: str) -> bool:
    """Whether a plant has no such part."""
    return getattr(plant, part, None) is None


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


def start_range(setup: Setup) -> tuple[Components, Components]:
    """Lowest and highest start, in state order, SI units.

    Starts are drawn uniformly in a box, so its corners are what the task makes of the ends of all
    its draws.
    """
    task, start = setup.task, setup.settings.start
    low, high = (task.draw_start(GivenNumbers(repeat(x)), start, {}) for x in (0.0, 1.0))
    return low, high


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
    for name in dir(type(part)):
        if isinstance(getattr(type(part), name, None), cached_property):
            getattr(part, name)
