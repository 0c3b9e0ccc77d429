"""Whether JAX can advance an environment."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ...catalogue import environment_setup
from ...episode import Setup


def checked_setup(env_id: str, arguments: Mapping[str, Any]) -> Setup:
    """The setup, if JAX can advance it.

    Raises:
        TypeError, ValueError: see :func:`integ_gym.envs.environments.functional.make`.
    """
    if arguments.get("contact") == "engine":
        raise ValueError(
            "the functional environment has no `contact`='engine'; use 'compliant', the same law "
            "in every engine, or gym.make or gym.make_vec"
        )
    setup = environment_setup(env_id, arguments)
    if not setup.engine.batched:
        raise ValueError(
            "the functional environment needs an engine made of JAX's operations, 'native' or "
            f"'mjx', got {setup.settings.engine!r}; use gym.make or gym.make_vec"
        )
    return setup
