"""Weights saved by ``torch.save(model.state_dict(), path)``, as CleanRL's scripts do.

Such a file holds numbers and their names: activation, bounds of the actions and normalization stand
in the side-car, which says them (:func:`~integ_gym.write_sidecar`).
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from integ_gym.support.files import read_bounded

from ..policy import (
    BoxActions,
    DiscreteActions,
    Layer,
    MlpPolicy,
    expand_bound,
)
from .limits import MAX_WEIGHTS_BYTES, PolicyFileError
from .sb3_weights import load_tensors

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
