"""The environment ids: registration with Gymnasium, and their classes."""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any, Final

import gymnasium as gym
from gymnasium.envs.registration import load_env_creator

from integ_gym.support import unknown_name

from ..environments import IntegEnv, make_setup
from ..episode import Mixture, Setup, make_mixture

_ID = re.compile(r'^ENV_ID: Final = "(\w+)(-v\d+)"$', re.MULTILINE)


def _declared() -> dict[str, str]:
    """Ids that the modules beside this one declare, read without importing them."""
    found = {}
    for path in sorted(Path(__file__).parent.glob("*.py")):
        for stem, version in _ID.findall(path.read_text(encoding="utf-8")):
            found[stem + version] = f"{__package__}.{path.stem}:{stem}"
    return found


ENVIRONMENTS: Final = _declared()
"""Environment id to module and common stem of its `Env` and `VectorEnv` class."""


def register_environments() -> None:
    """Register every id once; a second call changes nothing."""
    for env_id, stem in ENVIRONMENTS.items():
        if env_id not in gym.registry:
            gym.register(env_id, entry_point=f"{stem}Env", vector_entry_point=f"{stem}VectorEnv")


def environment_class(env_id: str) -> type[IntegEnv]:
    """The single environment's class.

    Raises:
        ValueError: for an id that is not one of ours, with the valid ones.
    """
    if env_id not in ENVIRONMENTS:
        raise ValueError(unknown_name("environment", env_id, ENVIRONMENTS))
    return load_env_creator(f"{ENVIRONMENTS[env_id]}Env")  # type: ignore[return-value]


def environment_setup(env_id: str, arguments: Mapping[str, Any]) -> Setup:
    """Plant, task, timing and engine that an id and its constructor arguments stand for.

    Raises:
        TypeError, ValueError: for what the environment's constructor refuses.
    """
    return make_setup(environment_class(env_id), arguments)


def environment_mixture(env_id: str, arguments: Mapping[str, Any]) -> Mixture:
    """The discretizations that an id and the arguments of its vector environment stand for.

    Args:
        env_id: a registered id.
        arguments: constructor arguments, ``mixture`` included or not.

    Raises:
        TypeError, ValueError: for what the environment's constructor refuses.
    """
    others = {name: value for name, value in arguments.items() if name != "mixture"}
    return make_mixture(partial(environment_setup, env_id), others, arguments.get("mixture"))
