"""A policy given as an object or as ``"module:function"``, not as a file."""

from __future__ import annotations

import importlib
import re
from collections.abc import Mapping
from dataclasses import is_dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from integ_gym.envs.sequential_vector import DiscretizedVectorEnv
from integ_gym.envs.testbeds.making import make_training_environments
from integ_gym.support.errors import InputError
from integ_gym.train.called_policy import CalledPolicy, behaviour_hash
from integ_gym.train.monitoring import RawModel
from integ_gym.train.policy import MlpPolicy, Policy
from integ_gym.train.policy_files.card import PolicyFileError
from integ_gym.train.policy_files.onnx import OnnxPolicy
from integ_gym.train.policy_files.sb3_zip import lacks_statistics, read_sb3_model
from integ_gym.train.policy_files.sidecar import Stated

from .home import provenance
from .policy import Existing, fitted, row_name

LANES, STEPS = 8, 16
"""Environments and decisions of the observations that a policy is known by."""

_REFERENCE = re.compile(r"[A-Za-z_][\w.]*:[A-Za-z_][\w.]*")


def is_reference(given: Any) -> bool:
    """Whether this names code, ``"module:function"``."""
    return isinstance(given, str) and _REFERENCE.fullmatch(given) is not None


def given_policy(
    given: Any, env_id: str, environment: Mapping[str, Any], home: Stated = None
) -> Existing:
    """What is known of a policy that an object is.

    Args:
        given: anything callable, from one observation to one action; anything with ``predict``,
            such as a model of stable-baselines3; a policy with ``act``; or ``"module:name"`` of
            one, of which a class is made without arguments.
        env_id: environment to evaluate in.
        environment: environment arguments of its training; not the discretization.
        home: what it was trained on.

    Raises:
        TypeError, ValueError: for what cannot be asked for actions, or for a home that cannot be;
            see also :func:`~integ_gym.eval.panel.existing.home.provenance`.
    """
    target = _loaded(given) if isinstance(given, str) else given
    known, environments = provenance(env_id, None, home, environment)
    policy = _as_policy(target, _name(given, target), env_id, known.environment, environments)
    policy = replace(policy, policy_id=row_name(policy.policy_id))
    bare = _is_sb3_model(target) and lacks_statistics(target)
    return Existing(policy, known, {}, None, environments.single_action_space, bare)


def _loaded(reference: str) -> Any:
    module, _, name = reference.partition(":")
    try:
        target: Any = importlib.import_module(module)
        for part in name.split("."):
            target = getattr(target, part)
        return target() if isinstance(target, type) else target
    except Exception as error:  # whatever the user's module does while it is imported
        raise InputError(
            f"cannot load policy {reference!r}: {type(error).__name__}: {error}; write it as "
            '"module:function", importable from here'
        ) from error


def _name(given: Any, target: Any) -> str:
    if isinstance(given, str):
        return given.rpartition(":")[2]
    named = getattr(target, "__name__", type(target).__name__)
    return "policy" if named == "<lambda>" else str(named)


def _as_policy(
    target: Any,
    name: str,
    env_id: str,
    arguments: Mapping[str, Any],
    environments: DiscretizedVectorEnv,
) -> Any:
    """A policy, checked against the environment's spaces.

    A model of stable-baselines3 is read as its file would be, so that it acts by the same numbers.
    """
    observation_space = environments.single_observation_space
    action_space = environments.single_action_space
    if _is_sb3_model(target):
        try:
            read = read_sb3_model(target, name)
            read.check_spaces(observation_space, action_space)
            return read
        except PolicyFileError:  # what is not read is asked
            target = RawModel(target)
    if isinstance(target, Policy):
        if is_dataclass(target):
            return _checked(target, observation_space, action_space)
        return CalledPolicy(target, action_space, target.policy_id, target.content_hash)
    called = CalledPolicy(target, action_space, name)
    observations = _observations(env_id, arguments)
    return replace(called, content_hash=behaviour_hash(called, observations))


def _checked(policy: Any, observation_space: Any, action_space: Any) -> Any:
    """One of our own policies, for these spaces."""
    if not isinstance(policy, MlpPolicy | OnnxPolicy):
        return policy
    fitting = fitted(policy, action_space)
    fitting.check_spaces(observation_space, action_space)
    return fitting


def _is_sb3_model(target: Any) -> bool:
    kinds = {base.__module__.partition(".")[0] for base in type(target).__mro__}
    return "stable_baselines3" in kinds and hasattr(target, "policy_kwargs")


def _observations(env_id: str, arguments: Mapping[str, Any]) -> NDArray[Any]:
    """Observations of the environment under random actions, the same every time."""
    environments = make_training_environments(env_id, arguments, LANES)
    environments.action_space.seed(0)
    observation, _ = environments.reset(seed=list(range(LANES)))  # type: ignore[arg-type]
    seen = [observation.copy()]
    for _ in range(STEPS):
        seen.append(environments.step(environments.action_space.sample())[0].copy())
    environments.close()
    return np.concatenate(seen)
