"""What records say of an environment: arguments, delays, packages, in JSON and in words."""

from __future__ import annotations

import json
from collections.abc import Mapping
from math import gcd
from typing import Any

import numpy as np

from integ_gym.envs import numerics
from integ_gym.envs.settings import NATIVE, Setup
from integ_gym.support.errors import InputTypeError
from integ_gym.support.optional import installed_versions

_PACKAGES = ("integ-gym", "gymnasium", "numpy")


def arguments(setup: Setup, lane: int) -> str:
    """JSON of {name: {"value": …, "unit": …}} for all constructor arguments."""
    values, units = setup.arguments(), setup.units()
    return json_text(
        {name: {"value": _of_lane(values[name], lane), "unit": units[name]} for name in values}
    )


def engine_description(setup: Setup, _: int) -> str:
    """What the engine says of itself, and what it was measured to be, if it is not ours; JSON."""
    settings, described = setup.settings, setup.engine.describe()
    if settings.engine not in (NATIVE, None) and setup.fingerprinted is not None:
        measured = numerics.fingerprint(settings.engine, settings.integrator, setup.fingerprinted)
        described = {**described, "fingerprint": measured.to_json()}
    return json_text(described)


def sensor_period(setup: Setup, _: int) -> float | None:
    """Time between two samples, s; None where it is not known."""
    timing = setup.timing
    if timing.dt is None:
        return None
    return (timing.substeps if timing.sensor is None else timing.sensor) * timing.dt


def action_latency(setup: Setup, _: int) -> float | None:
    """Delay of every command, s; None where it is not known."""
    timing = setup.timing
    return None if timing.dt is None else timing.latency * timing.dt


def staleness(setup: Setup) -> float:
    """Action latency plus the greatest age that a sample can have at a decision, s.

    0 where nothing is known of either.
    """
    timing = setup.timing
    if timing.dt is None:
        return 0.0
    age = 0 if timing.sensor is None else timing.sensor - gcd(timing.sensor, timing.substeps)
    return (timing.latency + age) * timing.dt


def in_words(fields: Mapping[str, Any]) -> str:
    """Engine, integrator and steps in words, from the record's fields of these names."""
    if fields["engine"] is None:
        return "an engine that is not known"
    return (
        f"{fields['integrator']} ({fields['engine']}) at dt {fields['dt']:.6g} s and control "
        f"period {fields['control_period']:.6g} s"
    )


def package_versions(further: Mapping[str, str]) -> dict[str, str]:
    """Versions of Python, of what integ-gym always needs, and of ``further`` packages."""
    return {**installed_versions(_PACKAGES), **further}


def json_text(value: Any) -> str:
    """JSON with sorted keys and no spaces; NumPy numbers as Python's own."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"), default=_plain)


def optional_json(value: Any) -> str | None:
    """The same, or None for None."""
    return None if value is None else json_text(value)


def _of_lane(value: Any, lane: int) -> Any:
    return value[lane].item() if isinstance(value, np.ndarray) else value


def _plain(value: Any) -> Any:
    try:
        return value.tolist()
    except AttributeError:
        raise InputTypeError(f"{value!r} cannot be written as JSON") from None
