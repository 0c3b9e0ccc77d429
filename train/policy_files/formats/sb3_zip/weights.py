"""The actor's weights in the member `policy.pth`, read without executing anything."""

from __future__ import annotations

import io
import math
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from integ_gym.support import missing

from ....policy import Layer
from ...error import DAMAGED, RETRAIN, PolicyFileError
from . import limits


def load_tensors(content: bytes, what: str = "its member 'policy.pth'") -> Mapping[str, Any]:
    """A state dict, by torch's reader that builds tensors and nothing else.

    Of several in a tuple, as CleanRL saves actor and critics, the first is the actor's.

    Args:
        content: of the file.
        what: a message calls it.
    """
    try:
        import torch
    except ImportError:
        raise missing("torch", "train") from None
    _check_archive(content, what)
    try:
        tensors = torch.load(io.BytesIO(content), map_location="cpu", weights_only=True)
    except Exception as error:  # hostile or damaged bytes can fail in any way inside torch
        raise PolicyFileError(
            f"{what} holds something other than plain weights; {DAMAGED}"
        ) from error
    if isinstance(tensors, tuple) and tensors:
        tensors = tensors[0]
    if not isinstance(tensors, dict) or not all(
        isinstance(name, str)
        and isinstance(tensor, torch.Tensor)
        and tensor.layout is torch.strided
        and tensor.dtype is torch.float32
        and tensor.device.type == "cpu"
        for name, tensor in tensors.items()
    ):
        raise PolicyFileError(f"{what} holds something other than float32 weights; {RETRAIN}")
    return tensors


def _check_archive(content: bytes, what: str) -> None:
    """Refuse weights that are not torch's zip format, or unpack to more than the limit."""
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            members = archive.infolist()
    except Exception as error:  # a damaged archive can fail in any way
        raise PolicyFileError(f"{what} is not in torch's zip format; {DAMAGED}") from error
    if any(Path(member.filename).name == "constants.pkl" for member in members):
        raise PolicyFileError(
            f"{what} is a TorchScript program, which is never run; export it with "
            "torch.onnx.export, or save the state_dict alone"
        )
    unpacked = sum(member.file_size for member in members)
    if unpacked > limits.MAX_WEIGHTS_BYTES:
        raise PolicyFileError(
            f"{what} unpacks to {unpacked} bytes, above the limit of "
            f"{limits.MAX_WEIGHTS_BYTES}; give a model with a smaller network"
        )


def layers_of(
    tensors: Mapping[str, Any], layers: Mapping[str, tuple[int, int]], unused: tuple[str, ...]
) -> tuple[Layer, ...]:
    """The actor's layers, checked name by name and shape by shape.

    Args:
        tensors: the state dict.
        layers: inputs and outputs of each by its name, input first.
        unused: beginnings of the names of other weights.
    """
    sizes = tuple(after for _, after in layers.values())[:-1]
    expected = {
        f"{name}.{part}": shape
        for name, (before, after) in layers.items()
        for part, shape in (("weight", (after, before)), ("bias", (after,)))
    }
    for name in tensors:
        if name not in expected and not name.startswith(unused):
            raise PolicyFileError(
                f"the weights '{name}' have no place in the saved architecture {sizes}; {DAMAGED}"
            )
    for name, shape in expected.items():
        found = tuple(tensors[name].shape) if name in tensors else "none"
        if found != shape:
            raise PolicyFileError(
                f"the weights '{name}' should have shape {shape} for the saved architecture "
                f"{sizes} and have {found}; {DAMAGED}"
            )
    if 4 * sum(math.prod(shape) for shape in expected.values()) > limits.MAX_WEIGHTS_BYTES:
        raise PolicyFileError(
            f"the actor needs more than {limits.MAX_WEIGHTS_BYTES} bytes; "
            "give a model with a smaller network"
        )
    return tuple(
        (tensors[f"{name}.weight"].numpy(), tensors[f"{name}.bias"].numpy()) for name in layers
    )


def averaged(layers: tuple[Layer, ...], quantiles: int) -> tuple[Layer, ...]:
    """The same network with the mean over quantiles, which come first, as its outputs."""
    if quantiles == 1:
        return layers
    *hidden, (weight, bias) = layers
    actions = len(bias) // quantiles
    mean = (
        weight.reshape(quantiles, actions, -1).mean(axis=0, dtype=np.float64),
        bias.reshape(quantiles, actions).mean(axis=0, dtype=np.float64),
    )
    return (*hidden, (mean[0].astype(np.float32), mean[1].astype(np.float32)))
