"""Policies and side-cars written by anybody: where a policy comes from, said beside it."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from integ_gym.envs import DISCRETIZATION, environment_setup, is_integ_environment
from integ_gym.support import replace_file

from ..policy import BoxActions, MlpPolicy
from .error import PolicyFileError
from .formats import (
    OnnxPolicy,
    lacks_statistics,
    onnx_bytes,
    read_observation_statistics,
    read_sb3_model,
    safetensors_bytes,
)
from .own_hash import FORMAT, hashed
from .reading import ONNX_ENDING, SAFETENSORS_ENDING, read_weights, unscaled
from .sidecar import has_sidecar, read_trained
from .stated_home import Stated, stated_arguments

_UNSCALED = (
    "was trained inside VecNormalize, whose statistics are missing; pass "
    'obs_stats="vecnormalize.pkl", also of one with norm_obs=False'
)


def write_sidecar(
    policy: str | os.PathLike[str],
    env_id: str,
    *,
    home: Stated,
    environment: Mapping[str, Any] | None = None,
    policy_id: str | None = None,
    seed: int | None = None,
    activation: str | None = None,
    actions: int | None = None,
    action_bounds: tuple[Sequence[float], Sequence[float]] | None = None,
    obs_stats: str | os.PathLike[str] | None = None,
) -> Path:
    """Say beside a policy's file what it was trained on, so that evaluations know.

    Args:
        policy: path of its file, which is read to see that it can be.
        env_id: environment that it is for.
        home: what it was trained on: ``"integrator=…,dt=…,control_period=…"``, the same as a
            mapping or a `Discretization`, or ``"stock"``; None: unknown.
        environment: further constructor arguments of its training environment.
        policy_id: its name; by default the file's.
        seed: of its training.
        activation: of a state dict, the name of the torch class, such as ``"Tanh"``.
        actions: of a state dict, the number of discrete actions.
        action_bounds: (low, high), each of shape (action_dim,), in the action's units.
        obs_stats: VecNormalize's statistics, which the side-car then holds.

    Returns:
        The side-car's path: the JSON file of the same name.

    Raises:
        PolicyFileError: for a policy that cannot be read, or whose `VecNormalize` is missing.
        ValueError: for a home that is none.
    """
    file = Path(policy)
    statistics = (
        None if obs_stats is None else _statistics_of(read_observation_statistics(obs_stats))
    )
    card = {
        "format": FORMAT,
        "policy_file": file.name,
        "policy_id": policy_id or file.stem,
        "seed": seed,
        "action_bounds": action_bounds and [[float(x) for x in side] for side in action_bounds],
        "network": {
            "activation": activation,
            "actions": actions,
            "observation_statistics": statistics,
        },
        **_training(env_id, home, environment),
    }
    if obs_stats is not None and statistics is None:
        card["network"]["scaled"] = False
    card["content_hash"] = read_weights(file, card).content_hash
    _check_scale(file, card)
    path = file.with_suffix(".json")
    text = json.dumps(hashed(card), indent=2, allow_nan=False, ensure_ascii=False) + "\n"
    replace_file(path, text.encode())
    return path


def save_policy(
    policy: Any,
    path: str | os.PathLike[str],
    env_id: str,
    *,
    home: Stated,
    environment: Mapping[str, Any] | None = None,
    policy_id: str | None = None,
    seed: int | None = None,
    obs_stats: str | os.PathLike[str] | None = None,
) -> Path:
    """Write a feed-forward policy: ``.onnx`` with metadata, or ``.safetensors`` with a side-car.

    Args:
        policy: a model of stable-baselines3, its file, or a policy that was read.
        path: of the file to write.
        env_id: environment that it is for.
        home: see :func:`write_sidecar`.
        environment: further constructor arguments of its training environment.
        policy_id: its name; by default the file's.
        seed: of its training.
        obs_stats: VecNormalize's statistics, which become part of the policy.

    Returns:
        The path.

    Raises:
        PolicyFileError: for a policy that is none of these, cannot be read, or whose `VecNormalize`
            is missing.
        ValueError: for another suffix, a home that is none, or a name whose side-car is another
            policy's.
    """
    file, name = Path(path), policy_id or Path(path).stem
    if file.suffix not in (ONNX_ENDING, SAFETENSORS_ENDING):
        raise ValueError(f"a policy is saved as .onnx or .safetensors, got {file.name!r}")
    own = _feed_forward(policy, name, None if obs_stats is None else Path(obs_stats))
    training = _training(env_id, home, environment)
    if file.suffix == SAFETENSORS_ENDING:
        _check_alone(file)
        replace_file(file, safetensors_bytes(own))
        write_sidecar(file, env_id, home=home, environment=environment, policy_id=name, seed=seed)
        return file
    card = {"policy_id": name, "seed": seed, **training, **_told(own, env_id)}
    replace_file(file, onnx_bytes(own, card))
    return file


def _feed_forward(policy: Any, name: str, obs_stats: Path | None) -> MlpPolicy:
    if isinstance(policy, str | os.PathLike):
        policy = _of_file(Path(policy), obs_stats)
    elif not isinstance(policy, MlpPolicy | OnnxPolicy):
        model, policy = policy, read_sb3_model(policy, name)
        if lacks_statistics(model):
            raise PolicyFileError(
                f"the model {name} was trained inside VecNormalize and is without it; load it with "
                "env=VecNormalize.load(path, venv)"
            )
    if not isinstance(policy, MlpPolicy):
        raise PolicyFileError("only a feed-forward policy is written; give one")
    return replace(policy, policy_id=name)


def _of_file(path: Path, obs_stats: Path | None) -> Any:
    """A policy with the statistics that are given, or that its side-car holds."""
    if not has_sidecar(path):
        policy, card = read_weights(path, obs_stats=obs_stats), None
    else:
        trained, card = read_trained(path)
        policy = trained if obs_stats is None else read_weights(path, card, obs_stats)
    if obs_stats is None:
        _check_scale(path, card)
    return policy


def _check_scale(path: Path, card: Mapping[str, Any] | None) -> None:
    """Refuse a policy that would act on observations of the wrong scale."""
    if unscaled(path, card):
        raise PolicyFileError(f"{path}: {_UNSCALED}")


def _check_alone(file: Path) -> None:
    """Refuse a name whose side-car is another policy's."""
    others = [p for p in file.parent.glob(f"{file.stem}.*") if p not in (file, _sidecar(file))]
    if not file.exists() and _sidecar(file).exists() and others:
        raise ValueError(
            f"{_sidecar(file)} is the side-car of {others[0].name}; give the new file another name"
        )


def _sidecar(file: Path) -> Path:
    return file.with_suffix(".json")


def _training(env_id: str, home: Stated, environment: Mapping[str, Any] | None) -> dict[str, Any]:
    """What a card says of the training."""
    arguments = stated_arguments(home, env_id)
    stated = {name: arguments[name] for name in DISCRETIZATION if name in arguments}
    return {
        "home": stated if "integrator" in stated else None,
        "config": {"env_id": env_id, "env_arguments": {**arguments, **(environment or {})}},
    }


def _statistics_of(own: Any) -> dict[str, Any] | None:
    if own is None:
        return None
    limits = {"epsilon": own.epsilon, "clip_obs": own.clip_obs}
    return {"mean": own.mean.tolist(), "var": own.var.tolist(), **limits}


def _told(policy: MlpPolicy, env_id: str) -> dict[str, Any]:
    """What a robot's software asks: order and scale of observations and actions."""
    setup = environment_setup(env_id, {}) if is_integ_environment(env_id) else None
    bounds = policy.actions if isinstance(policy.actions, BoxActions) else None
    return {
        "observations": list(setup.task.observation_names) if setup else None,
        "observation_units": list(setup.task.observation_units) if setup else None,
        "observation_statistics": _statistics_of(policy.statistics),
        "actions": [setup.plant.control_name] if setup else None,
        "action_low": bounds and bounds.low.tolist(),
        "action_high": bounds and bounds.high.tolist(),
        "activation": policy.activation,
    }
