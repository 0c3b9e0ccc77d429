"""The actor's weights in the member `policy.pth`, read without executing anything."""

from __future__ import annotations

import io
import math
import zipfile
from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any

from integ_gym.support import missing

from ...policy import Layer
from ..error import DAMAGED, RETRAIN, PolicyFileError
from . import limits

_UNUSED_WEIGHTS = ("mlp_extractor.value_net.", "value_net.", "log_std")


def load_tensors(content: bytes) -> Mapping[str, Any]:
    """The state dict in `policy.pth`, by torch's reader that builds tensors and nothing else."""
    try:
        import torch
    except ImportError:
        raise missing("torch", "train") from None
    _check_archive(content)
    try:
        tensors = torch.load(io.BytesIO(content), map_location="cpu", weights_only=True)
    except Exception as error:  # hostile or damaged bytes can fail in any way inside torch
        raise PolicyFileError(
            f"its member 'policy.pth' holds something other than plain weights; {DAMAGED}"
        ) from error
    if not isinstance(tensors, dict) or not all(
        isinstance(name, str)
        and isinstance(tensor, torch.Tensor)
        and tensor.layout is torch.strided
        and tensor.dtype is torch.float32
        and tensor.device.type == "cpu"
        for name, tensor in tensors.items()
    ):
        raise PolicyFileError(
            f"its member 'policy.pth' holds something other than float32 weights; {RETRAIN}"
        )
    return tensors


def _check_archive(content: bytes) -> None:
    """Refuse weights that are not torch's zip format, or unpack to more than the limit."""
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            members = archive.infolist()
    except Exception as error:  # a damaged archive can fail in any way
        raise PolicyFileError(
            f"its member 'policy.pth' is not in torch's zip format; {DAMAGED}"
        ) from error
    if any(Path(member.filename).name == "constants.pkl" for member in members):
        raise PolicyFileError(
            f"its member 'policy.pth' is a TorchScript program, not weights; {DAMAGED}"
        )
    unpacked = sum(member.file_size for member in members)
    if unpacked > limits.MAX_WEIGHTS_BYTES:
        raise PolicyFileError(
            f"its member 'policy.pth' unpacks to {unpacked} bytes, above the limit of "
            f"{limits.MAX_WEIGHTS_BYTES}; give a model with a smaller network"
        )


def layers_of(tensors: Mapping[str, Any], sizes: tuple[int, ...]) -> tuple[Layer, ...]:
    """The actor's layers, checked name by name and shape by shape.

    Args:
        tensors: the state dict.
        sizes: inputs, hidden layers, outputs.
    """
    hidden = [f"mlp_extractor.policy_net.{2 * index}" for index in range(len(sizes) - 2)]
    names = [*hidden, "action_net"]
    expected = {
        f"{name}.{part}": shape
        for name, (before, after) in zip(names, pairwise(sizes), strict=True)
        for part, shape in (("weight", (after, before)), ("bias", (after,)))
    }
    for name in tensors:
        if name not in expected and not name.startswith(_UNUSED_WEIGHTS):
            raise PolicyFileError(
                f"the weights '{name}' have no place in the saved architecture "
                f"{sizes[1:-1]}; {DAMAGED}"
            )
    for name, shape in expected.items():
        found = tuple(tensors[name].shape) if name in tensors else "none"
        if found != shape:
            raise PolicyFileError(
                f"the weights '{name}' should have shape {shape} for the saved architecture "
                f"{sizes[1:-1]} and have {found}; {DAMAGED}"
            )
    if 4 * sum(math.prod(shape) for shape in expected.values()) > limits.MAX_WEIGHTS_BYTES:
        raise PolicyFileError(
            f"the actor needs more than {limits.MAX_WEIGHTS_BYTES} bytes; "
            "give a model with a smaller network"
        )
    return tuple(
        (tensors[f"{name}.weight"].numpy(), tensors[f"{name}.bias"].numpy()) for name in names
    )
