"""The discretization fields of a record, read from an environment's setup."""

from __future__ import annotations

from math import gcd
from typing import Any

import numpy as np

from integ_gym.envs.numerics.fingerprint import fingerprint
from integ_gym.envs.settings import Setup
from integ_gym.evidence.context import json_text


def describe(setup: Setup, lane: int = 0) -> dict[str, Any]:
    """All fields of group ``discretization``, and ``metric``, for one environment.

    Args:
        setup: the environment's setup.
        lane: which value to take of plant parameters given as arrays.
    """
    settings, timing = setup.settings, setup.timing
    sensor = timing.substeps if timing.sensor is None else timing.sensor
    return {
        "engine": settings.engine,
        "engine_version": setup.engine.version,
        "engine_description": json_text(_engine(setup)),
        "integrator": settings.integrator,
        "dt": timing.dt,
        "control_period": timing.control_period,
        "substeps": timing.substeps,
        "sensor_period": sensor * timing.dt,
        "action_latency": timing.latency * timing.dt,
        "observation_noise": settings.observation_noise,
        **{name: setup.engine.solver().get(name) for name in ("solver_tolerance", "solver_cap")},
        "duration": settings.duration,
        "fallback": settings.fallback,
        "max_speed": settings.max_speed,
        "start": settings.start,
        "arguments": arguments(setup, lane),
        "metric": "success",
        "metric_definition": setup.task.goal,
        "latency_budget": timing.control_period,
    }


def arguments(setup: Setup, lane: int = 0) -> str:
    """JSON of {name: {"value": …, "unit": …}} for all constructor arguments."""
    values, units = setup.arguments(), setup.units()
    return json_text(
        {name: {"value": _of_lane(values[name], lane), "unit": units[name]} for name in values}
    )


def _engine(setup: Setup) -> dict[str, Any]:
    """What the engine says of itself, and what it was measured to be, if it is not ours."""
    settings = setup.settings
    if settings.engine == "native":
        return setup.engine.describe()
    measured = fingerprint(settings.engine, settings.integrator, setup.fingerprinted)
    return {**setup.engine.describe(), "fingerprint": measured.to_json()}


def staleness(setup: Setup) -> float:
    """Action latency plus the greatest age that a sample can have at a decision, s."""
    timing = setup.timing
    age = 0 if timing.sensor is None else timing.sensor - gcd(timing.sensor, timing.substeps)
    return (timing.latency + age) * timing.dt


def in_words(description: dict[str, Any]) -> str:
    """Engine, integrator and steps in words."""
    return (
        f"{description['integrator']} ({description['engine']}) at dt "
        f"{description['dt']:.6g} s and control period {description['control_period']:.6g} s"
    )


def _of_lane(value: Any, lane: int) -> Any:
    return value[lane].item() if isinstance(value, np.ndarray) else value
