"""Policies read from files: state dicts, and every other format by its ending."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple
from zipfile import is_zipfile

from integ_gym.support.files import read_bounded

from ..policy import (
    BoxActions,
    DiscreteActions,
    Layer,
    MlpPolicy,
    ObservationStatistics,
    expand_bound,
)
from .card import MAX_WEIGHTS_BYTES, PolicyFileError
from .onnx import read_onnx
from .programs import ProgramPolicy, TorchScriptPolicy, is_torchscript
from .safetensors_file import read_safetensors
from .sb3_weights import load_tensors
from .sb3_zip import (
    GivenStatistics,
    is_scaled,
    observation_statistics_of,
    read_sb3_zip,
)

STATE_DICT_ENDINGS = (".pt", ".pth", ".cleanrl_model")

_ALONE = (
    "holds weights alone; write its side-car with integ_gym.write_sidecar(path, env_id, home=..., "
    "activation=..., action_bounds=(low, high) or actions=N), or export the actor with "
    "torch.onnx.export"
)
_OTHER = "save the actor's state_dict alone, in float32, or export the actor with torch.onnx.export"


class _Form(NamedTuple):
    """Names of an actor's layers, and whether its actions are squashed."""

    layers: str
    squash: bool


_FORMS = (
    _Form(r"actor_mean\.\d+", False),
    _Form(r"actor\.\d+", False),
    _Form(r"network\.\d+", False),
    _Form(r"fc\d+|fc_mean", True),
    _Form(r"fc\d+|fc_mu", True),
    _Form(r"\d+", False),
)
"""Of CleanRL's ppo_continuous_action, ppo, dqn, sac_continuous_action, td3_continuous_action and
ddpg_continuous_action, and of a bare `Sequential`."""

_LAST = ("fc_mean", "fc_mu")


def read_state_dict(path: Path, network: Mapping[str, Any]) -> MlpPolicy:
    """The policy of a state dict.

    Args:
        path: of the file.
        network: what its side-car says: ``activation``; ``action_bounds`` (low, high) where the
            file does not hold them, or ``actions``, the number of discrete ones.

    Raises:
        PolicyFileError: in one sentence, if it cannot be read without executing something, or does
            not fit what is said of it.
    """
    try:
        tensors = _tensors(path)
        if not network.get("activation"):
            raise PolicyFileError(_ALONE)
        form, layers = _layers(tensors)
        actions = _actions(network, form.squash, tensors, len(layers[-1][1]))
        return MlpPolicy(layers, str(network["activation"]), actions, policy_id=path.stem)
    except (KeyError, TypeError, ValueError) as error:
        raise PolicyFileError(f"{path}: {error}") from error


def normalizes(path: Path) -> bool:
    """Whether a state dict is of an actor that learned from normalized observations.

    CleanRL's ppo_continuous_action, which calls its actor `actor_mean`, always normalizes them and
    saves no statistics; its other scripts do not.
    """
    return any(name.startswith("actor_mean.") for name in _tensors(path))


def _tensors(path: Path) -> Mapping[str, Any]:
    try:
        return load_tensors(read_bounded(path, MAX_WEIGHTS_BYTES), "the file", _OTHER)
    except OSError as error:
        raise PolicyFileError(f"cannot be opened ({error.strerror}); check the path") from error


def _layers(tensors: Mapping[str, Any]) -> tuple[_Form, tuple[Layer, ...]]:
    weights = [name.removesuffix(".weight") for name in tensors if name.endswith(".weight")]
    for form in _FORMS:
        own = [name for name in weights if re.fullmatch(form.layers, name)]
        ends = [name for name in own if name in _LAST]
        if own and (bool(ends) or not form.squash):
            order = sorted(own, key=lambda name: (name in _LAST, _number(name)))
            return form, tuple((_of(tensors, n, "weight"), _of(tensors, n, "bias")) for n in order)
    raise PolicyFileError(
        f"has layers {', '.join(weights[:6]) or 'none'}, and an actor is looked for under the "
        "names of CleanRL's scripts (actor_mean.N, actor.N, network.N, fcN with fc_mean or "
        "fc_mu); export the actor with torch.onnx.export, or give a function from Python"
    )


def _number(name: str) -> int:
    digits = re.findall(r"\d+", name)
    return int(digits[-1]) if digits else 0


def _of(tensors: Mapping[str, Any], name: str, part: str) -> Any:
    if f"{name}.{part}" not in tensors:
        raise PolicyFileError(f"lacks the weights '{name}.{part}'; save the whole state_dict")
    return tensors[f"{name}.{part}"].numpy()


def _actions(
    network: Mapping[str, Any], squash: bool, tensors: Mapping[str, Any], outputs: int
) -> BoxActions | DiscreteActions:
    if network.get("actions") is not None:
        return DiscreteActions(int(network["actions"]))
    if network.get("action_bounds") is not None:
        low, high = (expand_bound(side, outputs) for side in network["action_bounds"])
        return BoxActions(low, high, squash)
    if {"action_scale", "action_bias"} <= set(tensors):
        scale, middle = (tensors[f"action_{x}"].numpy().ravel() for x in ("scale", "bias"))
        return BoxActions(middle - scale, middle + scale, squash)
    raise PolicyFileError(
        "needs the bounds of its actions, or their number where they are discrete; write its "
        "side-car with integ_gym.write_sidecar(..., action_bounds=(low, high)) or (..., actions=N)"
    )


ONNX_ENDING, SAFETENSORS_ENDING = ".onnx", ".safetensors"
POLICY_ENDINGS = (".zip", ONNX_ENDING, *STATE_DICT_ENDINGS, SAFETENSORS_ENDING)
"""Of the files that are read; where several hold one policy, the first is the one to read."""

_PICKLES = (".pkl", ".pickle", ".joblib", ".cloudpickle", ".dill")
_WAY = (
    "export the actor with torch.onnx.export, save it with integ_gym.save_policy, or judge it from "
    "Python: integ_gym.evaluate(policy, env_id, out)"
)


def read_weights(
    path: Path, card: Mapping[str, Any] | None = None, obs_stats: GivenStatistics = None
) -> MlpPolicy | ProgramPolicy:
    """The policy of a file, without what a side-car says of its training.

    Args:
        path: a zip of stable-baselines3 or sb3-contrib, ``.safetensors``, ``.onnx``, or a state
            dict or TorchScript program: ``.pt``, ``.pth`` or ``.cleanrl_model``. A program is not
            run before it acts.
        card: content of its side-car.
        obs_stats: statistics of its observations; by default those that the side-car holds.

    Raises:
        PolicyFileError: in one sentence, for a file that cannot be read without executing
            something, with the way that works.
    """
    facts = card or {}
    network = facts.get("network") or {}
    policy = _read(path, network, facts.get("action_bounds"))
    statistics = _statistics(network) if obs_stats is None else observation_statistics_of(obs_stats)
    if statistics is None:
        if obs_stats is False and getattr(policy, "statistics", None) is not None:
            raise PolicyFileError(f"{path}: holds statistics of its own; leave out obs_stats=False")
        return policy
    try:
        return replace(policy, statistics=statistics)
    except ValueError as error:
        raise PolicyFileError(f"{path}: {error}") from error


def unscaled(path: Path, card: Mapping[str, Any] | None = None) -> bool:
    """Whether a policy learned from scaled observations, and its files lack their statistics.

    Args:
        path: of a file that :func:`read_weights` reads.
        card: content of its side-car.
    """
    suffix, network = path.suffix.lower(), (card or {}).get("network") or {}
    if suffix in (ONNX_ENDING, SAFETENSORS_ENDING):
        return False
    if network.get("observation_statistics") is not None or network.get("scaled") is False:
        return False
    if suffix in STATE_DICT_ENDINGS:
        return not is_torchscript(path) and normalizes(path)
    return is_scaled(path)


def _read(path: Path, network: Mapping[str, Any], bounds: Any) -> MlpPolicy | ProgramPolicy:
    suffix = path.suffix.lower()
    _check_file(path)
    if suffix == SAFETENSORS_ENDING:
        return read_safetensors(path)
    if suffix == ONNX_ENDING:
        return read_onnx(path)
    if suffix in _PICKLES:
        raise PolicyFileError(
            f"{path}: is a pickle, which runs what it holds when it is read; {_WAY}"
        )
    if suffix in STATE_DICT_ENDINGS and is_torchscript(path):
        return TorchScriptPolicy(read_bounded(path, MAX_WEIGHTS_BYTES), policy_id=path.stem)
    if suffix in STATE_DICT_ENDINGS:
        return read_state_dict(path, {"action_bounds": bounds, **network})
    return read_sb3_zip(path, action_bounds=bounds)


def _check_file(path: Path) -> None:
    """Refuse what is no policy's file by its name, with what may have been meant.

    Raises:
        PolicyFileError: in one sentence.
    """
    if path.is_dir():
        held = [path / f"policy{ending}" for ending in POLICY_ENDINGS]
        found = next((str(file) for file in held if file.exists()), "the file of a policy in it")
        raise PolicyFileError(f"{path}: is a folder; give {found}")
    if not path.exists() and path.suffix.lower() not in POLICY_ENDINGS:
        held = [path.with_name(path.name + ending) for ending in POLICY_ENDINGS]
        found = next((f"give {file}" for file in held if file.exists()), "")
        raise PolicyFileError(
            f"{path}: there is no such file; "
            f"{found or 'give a file, or a function of your own as --policy MODULE:FUNCTION'}"
        )
    known = path.suffix.lower() in (*POLICY_ENDINGS, *_PICKLES)
    if not known and path.is_file() and not is_zipfile(path):
        raise PolicyFileError(
            f"{path}: its ending is none of those that are read "
            f"({', '.join(POLICY_ENDINGS)}); name it by its format, or {_WAY}"
        )


def _statistics(network: Mapping[str, Any]) -> ObservationStatistics | None:
    given = network.get("observation_statistics")
    try:
        return None if given is None else ObservationStatistics(**given)
    except (TypeError, ValueError) as error:
        raise PolicyFileError(
            f"the side-car's observation statistics cannot be read ({error}); write it again"
        ) from error
