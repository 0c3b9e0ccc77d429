"""The class of an environment id, and what its arguments stand for."""

from __future__ import annotations

import importlib
import re
from collections.abc import Mapping
from functools import cache, partial
from typing import Any, Final

import gymnasium as gym
from gymnasium.envs.registration import load_env_creator

from integ_gym.support.errors import InputError
from integ_gym.support.parameters import unknown_name

from ..environment import IntegEnv, make_setup
from ..registries import ENVIRONMENTS
from ..settings import Mixture, Setup, make_mixture

_OWN_ID = re.compile(r"(?P<module>[\w.]+):(?P<name>[\w/-]+-v\d+)")

OWN_ENVIRONMENT: Final = 'your own IntegEnv as "module:Id-v0"'
"""What is taken beside :data:`ENVIRONMENTS` where the equations of motion are needed."""

OTHER_TESTBEDS: Final = (
    "a task of Gymnasium's such as Acrobot-v1 or Hopper-v5, one of another library's such as "
    'brax:ant, your own as "module:Id-v0", or a testbed of your own as "module:Class"'
)
"""What is taken beside :data:`ENVIRONMENTS` where any testbed is."""


def is_integ_environment(env_id: str) -> bool:
    """Whether an id is of an :class:`IntegEnv`: one of ours, or ``"my_task:Settle-v0"``.

    Raises:
        ValueError: if the module that such an id names cannot be imported, or registers no such id.
    """
    return env_id in ENVIRONMENTS or _own_class(env_id) is not None


def environment_class(env_id: str) -> type[IntegEnv]:
    """The single environment's class.

    Args:
        env_id: one of ours, or one that a module registers, in Gymnasium's notation
            ``"module:Id-v0"``.

    Raises:
        ValueError: for an id that is of no :class:`IntegEnv`, with the valid ones.
    """
    if env_id in ENVIRONMENTS:
        return load_env_creator(f"{ENVIRONMENTS[env_id]}Env")  # type: ignore[return-value]
    own = _own_class(env_id)
    if own is None:
        if ":" not in env_id and env_id not in gym.registry:
            unknown = unknown_name("environment", env_id, ENVIRONMENTS)
            raise InputError(f"{unknown}, or {OWN_ENVIRONMENT}")
        raise InputError(
            f"{env_id!r} does not give its equations of motion, which are needed here; give "
            f"{', '.join(sorted(ENVIRONMENTS))}, or {OWN_ENVIRONMENT}"
        )
    return own


@cache
def _own_class(env_id: str) -> type[IntegEnv] | None:
    """The class of an id in Gymnasium's notation; None if it is none, or no :class:`IntegEnv`."""
    named = _OWN_ID.fullmatch(env_id)
    if named is None:
        return None
    module, name = named["module"], named["name"]
    try:
        importlib.import_module(module)
    except Exception as error:  # whatever the user's module does while it is imported
        raise InputError(
            f"cannot import {module!r} of {env_id!r}: {type(error).__name__}: {error}; start where "
            "its file lies, or put its folder on PYTHONPATH"
        ) from error
    if name not in gym.registry:
        raise InputError(
            f"{module!r} registers no environment {name!r}; call gymnasium.register in it"
        )
    entry = gym.registry[name].entry_point
    made = load_env_creator(entry) if isinstance(entry, str) else entry
    return made if isinstance(made, type) and issubclass(made, IntegEnv) else None


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
