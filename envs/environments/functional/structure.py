"""What of a functional environment decides the compiled program."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ...episode import Setup
from ...plants import Plant

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
