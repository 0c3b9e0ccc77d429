"""The actor's weights in the member `policy.pth`, read without executing anything."""

from __future__ import annotations

import io
import math
import pickletools
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from integ_gym.support.optional import missing

from ....policy.network import Layer
from ...error import DAMAGED, RETRAIN, PolicyFileError
from . import limits

_RSL_RL = ("actor_state_dict", "model_state_dict")
"""What a checkpoint of rsl_rl calls the network, since 4.0 and before."""

_OLD_FORMAT = b"\x80\x02\x8a\x0al\xfc\x9cF\xf9 j\xa8P\x19."
"""How a file begins that torch before 1.6 wrote: its magic number, pickled."""

_OLD_PICKLES = 4
"""What follows, each a pickle, before the numbers: version, machine, object, names of storages."""


def load_tensors(
    content: bytes, what: str = "its member 'policy.pth'", remedy: str = ""
) -> Mapping[str, Any]:
    """A state dict, by torch's reader that builds tensors and nothing else.

    Of several in a tuple, as CleanRL saves actor and critics, the first is the actor's.

    Args:
        content: of the file, in torch's zip format or its older one.
        what: a message calls it.
        remedy: what helps where it holds something else, of a file that is no zip of SB3's.

    Raises:
        PolicyFileError: in one sentence, for anything else.
        ModuleNotFoundError: without torch.
    """
    try:
        import torch
    except ImportError:
        raise missing("torch", "train") from None
    if content.startswith(_OLD_FORMAT):
        _check_old_format(content, what)
    else:
        _check_archive(content, what)
    try:
        tensors = torch.load(io.BytesIO(content), map_location="cpu", weights_only=True)
    except Exception as error:  # hostile or damaged bytes can fail in any way inside torch
        raise PolicyFileError(
            f"{what} holds something other than plain weights; {remedy or DAMAGED}"
        ) from error
    if isinstance(tensors, tuple) and tensors:
        tensors = tensors[0]
    if isinstance(tensors, dict) and any(isinstance(part, dict) for part in tensors.values()):
        raise PolicyFileError(f"{what} {_checkpoint(tensors, remedy or RETRAIN)}")
    if not isinstance(tensors, dict) or not all(
        isinstance(name, str)
        and isinstance(tensor, torch.Tensor)
        and tensor.layout is torch.strided
        and tensor.dtype is torch.float32
        and tensor.device.type == "cpu"
        for name, tensor in tensors.items()
    ):
        raise PolicyFileError(
            f"{what} holds something other than float32 weights; {remedy or RETRAIN}"
        )
    return tensors


def _checkpoint(parts: Mapping[Any, Any], remedy: str) -> str:
    """What the checkpoint of a training is, and what helps."""
    if any(name in parts for name in _RSL_RL):
        return (
            "is a checkpoint of rsl_rl, which does not say how its network is built; export it to "
            'ONNX with runner.export_policy_to_onnx("exported") and give exported/policy.onnx'
        )
    names = ", ".join(str(name) for name in list(parts)[:6])
    return f"is the checkpoint of a training, with the parts {names}; {remedy}"


def _check_old_format(content: bytes, what: str) -> None:
    """Refuse weights in torch's older format that would take more memory than the limit."""
    stream = io.BytesIO(content[len(_OLD_FORMAT) :])
    try:
        read = [step for _ in range(_OLD_PICKLES) for step in pickletools.genops(stream)]
    except Exception as error:  # damaged bytes can fail in any way
        raise PolicyFileError(f"{what} is not a whole file of torch; {DAMAGED}") from error
    largest = max((given for _, given, _ in read if isinstance(given, int)), default=0)
    storages = sum(opcode.name in ("PERSID", "BINPERSID") for opcode, _, _ in read)
    if 4 * largest * max(1, storages) > limits.MAX_WEIGHTS_BYTES:
        raise PolicyFileError(
            f"{what} asks for more memory than the limit of {limits.MAX_WEIGHTS_BYTES} bytes; "
            "give a model with a smaller network"
        )


def _check_archive(content: bytes, what: str) -> None:
    """Refuse weights that are not torch's zip format, or unpack to more than the limit."""
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            members = archive.infolist()
    except Exception as error:  # a damaged archive can fail in any way
        raise PolicyFileError(f"{what} is no file that torch.save wrote; {DAMAGED}") from error
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
        (np.asarray(tensors[f"{name}.weight"]), np.asarray(tensors[f"{name}.bias"]))
        for name in layers
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
