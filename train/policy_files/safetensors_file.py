"""Policies as a `safetensors` file: weights and nothing that could be executed.

Tensors ``actor.N.weight`` (out, in) and ``actor.N.bias`` (out,), float32, input first; for a `Box`
action space ``actions.low`` and ``actions.high``. The file's metadata holds ``format``,
``activation`` and, for a `Discrete` action space, ``actions``: the number of actions.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from integ_gym.support import missing

from ..policy import BoxActions, DiscreteActions, MlpPolicy
from .error import PolicyFileError

try:
    from safetensors import SafetensorError, safe_open
    from safetensors.numpy import save
except ModuleNotFoundError as error:
    raise missing(str(error.name), "train") from error

FORMAT = "integ-gym MlpPolicy 1"


def safetensors_bytes(policy: MlpPolicy) -> bytes:
    """The file's content.

    Raises:
        ValueError: for a policy with observation statistics or squashed actions, which the format
            does not hold.
    """
    squashed = isinstance(policy.actions, BoxActions) and policy.actions.squash
    if policy.statistics is not None or squashed:
        raise ValueError(
            f"policy {policy.policy_id!r} scales observations or squashes actions, which "
            f"{FORMAT!r} files do not hold; keep its stable-baselines3 zip"
        )
    tensors: dict[str, NDArray[Any]] = {}
    for number, (weight, bias) in enumerate(policy.layers):
        tensors[f"actor.{number}.weight"], tensors[f"actor.{number}.bias"] = weight, bias
    metadata = {"format": FORMAT, "activation": policy.activation}
    if isinstance(policy.actions, DiscreteActions):
        metadata["actions"] = str(policy.actions.n)
    else:
        tensors["actions.low"], tensors["actions.high"] = policy.actions.low, policy.actions.high
    return _ordered(save(tensors, metadata))


def _ordered(content: bytes) -> bytes:
    """The same with the names of the header in order, so that equal policies are equal files.

    The header is JSON behind its length in 8 bytes, filled up with blanks to a multiple of 8.
    """
    end = 8 + int.from_bytes(content[:8], "little")
    header = json.dumps(json.loads(content[8:end]), sort_keys=True, separators=(",", ":")).encode()
    header += b" " * (-len(header) % 8)
    return len(header).to_bytes(8, "little") + header + content[end:]


def read_safetensors(path: str | os.PathLike[str]) -> MlpPolicy:
    """The policy of a file that :func:`safetensors_bytes` made; named by the file's stem.

    Raises:
        PolicyFileError: in one sentence, if it cannot be read or is of another format.
    """
    try:
        with safe_open(path, framework="numpy") as file:
            metadata: Mapping[str, str] = file.metadata() or {}
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    except (OSError, SafetensorError) as error:
        raise PolicyFileError(
            f"{path}: is not a readable safetensors file ({error}); give the file that the "
            "trainer wrote"
        ) from error
    if metadata.get("format") != FORMAT:
        raise PolicyFileError(
            f"{path}: has format {metadata.get('format')!r} where {FORMAT!r} was expected; give "
            "the file that the trainer wrote"
        )
    try:
        return _policy(metadata, tensors, Path(path).stem)
    except (KeyError, ValueError) as error:
        raise PolicyFileError(
            f"{path}: does not describe a policy ({error}); train it again"
        ) from error


def _policy(
    metadata: Mapping[str, str], tensors: Mapping[str, NDArray[np.float32]], name: str
) -> MlpPolicy:
    count = sum(key.endswith(".weight") for key in tensors)
    layers = tuple(
        (tensors[f"actor.{number}.weight"], tensors[f"actor.{number}.bias"])
        for number in range(count)
    )
    actions = (
        DiscreteActions(int(metadata["actions"]))
        if "actions" in metadata
        else BoxActions(tensors["actions.low"], tensors["actions.high"])
    )
    return MlpPolicy(layers, metadata["activation"], actions, policy_id=name)
