"""Policies as a `safetensors` file: weights and nothing that could be executed.

Tensors ``actor.N.weight`` (out, in) and ``actor.N.bias`` (out,), float32, input first; for a `Box`
action space ``actions.low`` and ``actions.high``. The file's metadata holds ``format``,
``activation`` and, for a `Discrete` action space, ``actions``: the number of actions. Where actions
are squashed, ``limit`` is what outputs are limited to before; observation statistics are float64
tensors ``observations.mean`` and ``observations.var`` with ``epsilon`` and ``clip_obs``. These
numbers are hexadecimal.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from integ_gym.support.files import check_regular
from integ_gym.support.optional import missing_package

from ..policy import BoxActions, DiscreteActions, MlpPolicy, ObservationStatistics
from .card import PolicyFileError

try:
    from safetensors import SafetensorError, safe_open
    from safetensors.numpy import save
except ModuleNotFoundError as error:
    raise missing_package(str(error.name), "report") from error

_TYPES = ("F16", "F32", "F64")
"""Types of tensors that are read; all but observation statistics become 32 bits wide."""

FORMAT = "integ-gym MlpPolicy 1"
FULL_FORMAT = "integ-gym MlpPolicy 2"
""":data:`FORMAT` with what readers of that one do not know: squashed actions, statistics."""


def safetensors_bytes(policy: MlpPolicy) -> bytes:
    """The file's content."""
    tensors: dict[str, NDArray[Any]] = {}
    for number, (weight, bias) in enumerate(policy.layers):
        tensors[f"actor.{number}.weight"], tensors[f"actor.{number}.bias"] = weight, bias
    metadata = {"format": FORMAT, "activation": policy.activation}
    if isinstance(policy.actions, DiscreteActions):
        metadata["actions"] = str(policy.actions.n)
    else:
        tensors["actions.low"], tensors["actions.high"] = policy.actions.low, policy.actions.high
        if policy.actions.squash:
            metadata |= {"format": FULL_FORMAT, "limit": policy.actions.limit.hex()}
    if policy.statistics is not None:
        own = policy.statistics
        tensors["observations.mean"], tensors["observations.var"] = own.mean, own.var
        numbers = {"epsilon": float(own.epsilon).hex(), "clip_obs": float(own.clip_obs).hex()}
        metadata |= {"format": FULL_FORMAT, **numbers}
    return _sort_header(save(tensors, metadata))


def _sort_header(content: bytes) -> bytes:
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
        check_regular(Path(path))
        with safe_open(path, framework="numpy") as file:
            metadata: Mapping[str, str] = file.metadata() or {}
            _check_types(file, path)
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    except (OSError, SafetensorError) as error:
        raise PolicyFileError(
            f"{path}: is not a readable safetensors file ({error}); give the file that the "
            "trainer wrote"
        ) from error
    if metadata.get("format") not in (FORMAT, FULL_FORMAT):
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


def _check_types(file: Any, path: str | os.PathLike[str]) -> None:
    for name in file.keys():  # noqa: SIM118
        dtype = file.get_slice(name).get_dtype()
        if dtype not in _TYPES:
            raise PolicyFileError(
                f"{path}: tensor {name!r} has dtype {dtype}, and a policy is read from "
                f"{', '.join(_TYPES)}; save its weights as F32, with tensor.to(torch.float32)"
            )


def _policy(
    metadata: Mapping[str, str], tensors: Mapping[str, NDArray[np.float32]], name: str
) -> MlpPolicy:
    count = sum(key.endswith(".weight") for key in tensors)
    layers = tuple(
        (tensors[f"actor.{number}.weight"], tensors[f"actor.{number}.bias"])
        for number in range(count)
    )
    return MlpPolicy(
        layers,
        metadata["activation"],
        _actions(metadata, tensors),
        _statistics(metadata, tensors),
        name,
    )


def _actions(
    metadata: Mapping[str, str], tensors: Mapping[str, NDArray[Any]]
) -> BoxActions | DiscreteActions:
    if "actions" in metadata:
        return DiscreteActions(int(metadata["actions"]))
    bounds = tensors["actions.low"], tensors["actions.high"]
    if "limit" not in metadata:
        return BoxActions(*bounds)
    return BoxActions(*bounds, squash=True, limit=float.fromhex(metadata["limit"]))


def _statistics(
    metadata: Mapping[str, str], tensors: Mapping[str, NDArray[Any]]
) -> ObservationStatistics | None:
    if "observations.mean" not in tensors:
        return None
    numbers = (float.fromhex(metadata[name]) for name in ("epsilon", "clip_obs"))
    return ObservationStatistics(
        tensors["observations.mean"], tensors["observations.var"], *numbers
    )
