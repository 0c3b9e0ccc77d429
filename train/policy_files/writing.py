"""Policies and the side-cars beside them, which say where a policy comes from."""

from __future__ import annotations

import json
import os
import warnings
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import ArrayLike

from integ_gym.envs.environment import environment_setup, is_integ_environment
from integ_gym.envs.settings import DISCRETIZATION
from integ_gym.support.errors import InputError, InputTypeError
from integ_gym.support.files import replace_file

from ..policy import BoxActions, MlpPolicy
from . import reading
from .card import FORMAT, PolicyFileError, card_bytes, hashed
from .onnx import onnx_bytes
from .programs import ProgramPolicy, is_torchscript
from .safetensors_file import safetensors_bytes
from .sb3_zip import GivenStatistics, lacks_statistics, observation_statistics_of, read_sb3_model
from .sidecar import Stated, has_sidecar, read_trained, stated_arguments

_UNSCALED = (
    "was trained inside VecNormalize, whose statistics are missing; pass "
    'obs_stats="vecnormalize.pkl", also of one with norm_obs=False'
)
_NORMALIZED = (
    "has the actor of CleanRL's ppo_continuous_action, which learns from normalized observations "
    'and saves no statistics; pass obs_stats={"mean": rms.mean, "var": rms.var} with '
    'rms = envs.envs[0].get_wrapper_attr("obs_rms"), or obs_stats=False if this one was trained '
    "without NormalizeObservation"
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
    actions: int | spaces.Discrete | None = None,
    action_bounds: tuple[ArrayLike, ArrayLike] | spaces.Box | None = None,
    obs_stats: GivenStatistics = None,
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
        actions: of a state dict, the number of discrete actions, or their space.
        action_bounds: of a state dict, or of the rare zip that does not spell them out: (low,
            high), each one number for all actions or one for each, in their units; or their space.
        obs_stats: statistics of its observations, which the side-car then holds: the file of
            `VecNormalize`, or ``{"mean": …, "var": …}``; False: it learned from observations as
            they are.

    Returns:
        The side-car's path: the JSON file of the same name.

    Raises:
        PolicyFileError: for a policy that cannot be read, or whose `VecNormalize` is missing.
        TypeError, ValueError: for a home that is none, or an argument that this file cannot have.

    Warns:
        UserWarning: of a state dict that learned from normalized observations, without their
            statistics.
    """
    if not isinstance(policy, str | os.PathLike):
        raise InputTypeError(
            f"write_sidecar takes the path of a policy's file, got {type(policy).__name__}; write "
            "a model with integ_gym.save_policy, which says its home too"
        )
    file = Path(policy)
    _check_arguments(file, activation, actions, action_bounds)
    statistics = _statistics_of(observation_statistics_of(obs_stats))
    network: dict[str, Any] = {
        "activation": activation,
        "actions": None if actions is None else _count(actions),
        "observation_statistics": statistics,
    }
    if obs_stats is not None and statistics is None:
        network["scaled"] = False
    card = _plain(
        {
            "format": FORMAT,
            "policy_file": file.name,
            "policy_id": policy_id or file.stem,
            "seed": seed,
            "action_bounds": None if action_bounds is None else _bounds(action_bounds),
            "network": network,
            **_describe_training(env_id, home, environment),
        }
    )
    card["content_hash"] = reading.read_weights(file, card).content_hash
    if reading.unscaled(file, card):
        if file.suffix.lower() not in reading.STATE_DICT_ENDINGS:
            raise PolicyFileError(f"{file}: {_UNSCALED}")
        card["network"]["scaled"] = True
        warnings.warn(f"{file}: {_NORMALIZED}", stacklevel=2)
    path = file.with_suffix(".json")
    replace_file(path, card_bytes(hashed(card)))
    return path


def _check_arguments(file: Path, activation: Any, actions: Any, action_bounds: Any) -> None:
    """Refuse what is said of a file that says it itself, or twice."""
    of_state_dict = file.suffix.lower() in reading.STATE_DICT_ENDINGS and not is_torchscript(file)
    given = {"activation": activation, "actions": actions}
    if file.suffix.lower() in (reading.ONNX_ENDING, reading.SAFETENSORS_ENDING):
        given["action_bounds"] = action_bounds
    for name, value in given.items():
        if value is not None and not of_state_dict:
            raise InputError(f"`{name}` is for a state dict, and {file.name} says its own; omit it")
    if actions is not None and action_bounds is not None:
        raise InputError("actions are discrete or have bounds; give `actions` or `action_bounds`")


def _count(actions: Any) -> int:
    """How many discrete actions there are."""
    count = actions.n if isinstance(actions, spaces.Discrete) else actions
    if isinstance(count, bool) or not isinstance(count, int | np.integer) or count < 1:
        raise InputError(f"`actions` is the number of discrete actions, such as 2, got {count!r}")
    return int(count)


def _bounds(given: Any) -> list[list[float]]:
    """Lower and upper bounds of the actions, as the side-car holds them."""
    sides = (given.low, given.high) if isinstance(given, spaces.Box) else given
    try:
        low, high = (np.asarray(side, dtype=float).ravel().tolist() for side in sides)
    except (TypeError, ValueError):
        raise InputError(
            "`action_bounds` are (low, high), each one number for all actions or one for each, "
            f"such as (-2.0, 2.0), got {given!r:.60}"
        ) from None
    return [low, high]


def _plain(card: Mapping[str, Any]) -> dict[str, Any]:
    """The same as JSON, NumPy's numbers and arrays as Python's."""

    def convert(value: Any) -> Any:
        if isinstance(value, np.generic | np.ndarray):
            return value.tolist()
        raise InputTypeError(
            f"a side-car holds numbers, texts, lists and objects, got {type(value).__name__}; give "
            "`environment`, `home` and `seed` as such"
        )

    plain: dict[str, Any] = json.loads(json.dumps(card, default=convert))
    return plain


def save_policy(
    policy: Any,
    path: str | os.PathLike[str],
    env_id: str,
    *,
    home: Stated,
    environment: Mapping[str, Any] | None = None,
    policy_id: str | None = None,
    seed: int | None = None,
    obs_stats: GivenStatistics = None,
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
        obs_stats: statistics of its observations, which become part of the policy; see
            :func:`write_sidecar`.

    Returns:
        The path.

    Raises:
        PolicyFileError: for a policy that is none of these, cannot be read, or whose `VecNormalize`
            is missing.
        ValueError: for another suffix, a home that is none, or a name whose side-car is another
            policy's.
    """
    file, name = Path(path), policy_id or Path(path).stem
    if file.suffix not in (reading.ONNX_ENDING, reading.SAFETENSORS_ENDING):
        raise InputError(f"a policy is saved as .onnx or .safetensors, got {file.name!r}")
    own = _feed_forward(policy, name, obs_stats)
    training = _describe_training(env_id, home, environment)
    if file.suffix == reading.SAFETENSORS_ENDING:
        sidecar = file.with_suffix(".json")
        others = [p for p in file.parent.glob(f"{file.stem}.*") if p not in (file, sidecar)]
        if not file.exists() and sidecar.exists() and others:
            raise InputError(
                f"{sidecar} is the side-car of {others[0].name}; give the new file another name"
            )
        replace_file(file, safetensors_bytes(own))
        write_sidecar(file, env_id, home=home, environment=environment, policy_id=name, seed=seed)
        return file
    card = _plain({"policy_id": name, "seed": seed, **training, **_describe_interface(own, env_id)})
    replace_file(file, onnx_bytes(own, card))
    return file


def _feed_forward(policy: Any, name: str, obs_stats: GivenStatistics) -> MlpPolicy:
    """The policy to write, with the statistics that are given or that are its own."""
    given = None
    if isinstance(policy, str | os.PathLike):
        path, card = Path(policy), None
        if has_sidecar(path):
            policy, card = read_trained(path)
        if card is None or obs_stats is not None:
            policy = reading.read_weights(path, card, obs_stats)
        if obs_stats is None and reading.unscaled(path, card):
            known = path.suffix.lower() in reading.STATE_DICT_ENDINGS
            raise PolicyFileError(f"{path}: {_NORMALIZED if known else _UNSCALED}")
    else:
        given = observation_statistics_of(obs_stats)
        if not isinstance(policy, MlpPolicy | ProgramPolicy):
            model, policy = policy, read_sb3_model(policy, name)
            if obs_stats is None and lacks_statistics(model):
                raise PolicyFileError(
                    f"the model {name} was trained inside VecNormalize and is without it; load it "
                    "with env=VecNormalize.load(path, venv), or pass obs_stats"
                )
        if obs_stats is not None and policy.statistics is not None:
            raise PolicyFileError(
                f"the policy {name} has statistics of its own; leave out obs_stats"
            )
    if isinstance(policy, ProgramPolicy):
        raise PolicyFileError(
            "an ONNX graph or a TorchScript program is run as it is, and written in no other "
            "format; give the model that it was exported from"
        )
    own: MlpPolicy = replace(policy, policy_id=name, statistics=given or policy.statistics)
    return own


def _describe_training(
    env_id: str, home: Stated, environment: Mapping[str, Any] | None
) -> dict[str, Any]:
    """What a card says of the training."""
    for name in (*DISCRETIZATION, "mixture"):
        if name in (environment or {}):
            raise InputError(
                f"`{name}` is a part of the home; say it in `home`, not in `environment`"
            )
    arguments = stated_arguments(home, env_id, environment or {})
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


def _describe_interface(policy: MlpPolicy, env_id: str) -> dict[str, Any]:
    """What a robot's software asks: order and scale of observations and actions."""
    setup = environment_setup(env_id, {}) if is_integ_environment(env_id) else None
    bounds = policy.actions if isinstance(policy.actions, BoxActions) else None
    return {
        "observations": list(setup.task.observation_names) if setup else None,
        "observation_units": list(setup.task.observation_units) if setup else None,
        "observation_statistics": _statistics_of(policy.statistics),
        "actions": [name for name, _ in setup.plant.controls] if setup else None,
        "action_low": bounds and bounds.low.tolist(),
        "action_high": bounds and bounds.high.tolist(),
        "activation": policy.activation,
    }
