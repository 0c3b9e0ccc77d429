"""A zip that lies beside its policy's weights, held against them; nothing in it is executed.

stable-baselines3 unpickles parts of `data` when it loads a model. What its pickles import must be
what stable-baselines3 writes, and nothing else.
"""

from __future__ import annotations

import base64
import io
import zipfile
from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..policy import ACTIVATIONS, BoxActions, MlpPolicy
from . import card
from .card import DAMAGED, PolicyFileError
from .pickles import (
    ARRAYS,
    SPACES,
    get_entries,
    read_pickle,
)
from .safetensors_file import read_safetensors
from .sb3_weights import json_object
from .sb3_zip import read_archive, read_member

_DATA, _TENSORS = "data", ".pth"
_MEMBERS = ("_stable_baselines3_version", "system_info.txt", "pytorch_variables.pth", "policy.pth")
_OPTIMIZER = "optimizer.pth"

_SERIALIZED = ":serialized:"

_IMPORTED = {
    *ARRAYS,
    *SPACES,
    ("collections", "deque"),
    *(("stable_baselines3.common.buffers", f"{name}Buffer") for name in ("Replay", "Rollout")),
    ("stable_baselines3.common.policies", "ActorCriticPolicy"),
    ("stable_baselines3.sac.policies", "SACPolicy"),
    ("stable_baselines3.common.type_aliases", "TrainFreq"),
    ("stable_baselines3.common.type_aliases", "TrainFrequencyUnit"),
    *(
        ("stable_baselines3.common.utils", f"{name}Schedule")
        for name in ("Constant", "Float", "Linear")
    ),
    *(("torch", f"{name}Storage") for name in ("Float", "Double", "Long", "Byte", "Bool")),
    ("torch._utils", "_rebuild_tensor_v2"),
    ("torch.optim.adam", "Adam"),
    *(("torch.nn.modules.activation", name) for name in ACTIVATIONS),
}
"""Module and name of all that the zips of our trainers import when they are loaded."""


def zip_faults(archive: Path, weights: Path) -> Iterator[str]:
    """What of a published zip is not of the policy whose weights lie beside it.

    Args:
        archive: SB3's zip.
        weights: the same policy as safetensors.
    """
    try:
        actor = read_safetensors(weights)
        with zipfile.ZipFile(archive) as held:
            yield from _find_faults(held, archive, actor)
    except (PolicyFileError, zipfile.BadZipFile) as error:
        yield f"cannot be read: {error}"
    except Exception as error:  # damaged bytes can fail in any way
        yield f"cannot be read ({type(error).__name__}); {DAMAGED}"


def _find_faults(held: zipfile.ZipFile, archive: Path, actor: MlpPolicy) -> Iterator[str]:
    for name in held.namelist():
        if name not in (_DATA, *_MEMBERS) and not name.endswith(_OPTIMIZER):
            yield f"has the member {name!r}, which no trainer writes"
    for name in (_DATA, *_MEMBERS):
        if name not in held.namelist():
            yield f"lacks the member {name!r}"
    for where, pickle in _iterate_pickles(held):
        try:
            read_pickle(pickle, _IMPORTED, storages=True)
        except PolicyFileError as error:
            yield f"{where} {error}"
    bounds = (
        (actor.actions.low, actor.actions.high) if isinstance(actor.actions, BoxActions) else None
    )
    own = read_archive(archive, actor.policy_id, actor.statistics, bounds, _read_tensors)
    if own.content_hash != actor.content_hash:
        yield "is another policy than the weights beside it"


def _iterate_pickles(held: zipfile.ZipFile) -> Iterator[tuple[str, bytes]]:
    for name in held.namelist():
        if name.endswith(_TENSORS):
            content = read_member(held, name, card.MAX_WEIGHTS_BYTES)
            with zipfile.ZipFile(io.BytesIO(content)) as inner:
                for member in inner.namelist():
                    if member.endswith(".pkl"):
                        yield name, read_member(inner, member, card.MAX_JSON_BYTES)
    content = read_member(held, _DATA, card.MAX_JSON_BYTES)
    data = json_object(content, f"its member 'data' {{}}; {DAMAGED}")
    for key, value in data.items():
        for text in _find_serialized(value):
            yield f"{key!r} of its 'data'", base64.b64decode(text)


def _find_serialized(value: Any) -> Iterator[str]:
    inner = value if isinstance(value, list) else ()
    if isinstance(value, Mapping):
        if isinstance(value.get(_SERIALIZED), str):
            yield value[_SERIALIZED]
        inner = list(value.values())
    for one in inner:
        yield from _find_serialized(one)


def _read_tensors(content: bytes) -> Mapping[str, NDArray[np.float32]]:
    """A state dict, read without torch."""
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        (name,) = (x for x in archive.namelist() if x.endswith("data.pkl"))
        folder = name.removesuffix("data.pkl")
        read = partial(read_member, archive, limit=card.MAX_WEIGHTS_BYTES)
        held = get_entries(read_pickle(read(name), _IMPORTED, storages=True))
        return {key: _array(one, folder, read) for key, one in held.items() if key != "_metadata"}


def _array(held: Any, folder: str, read: Any) -> NDArray[np.float32]:
    (_, kind, key, *_), offset, shape, strides = held.arguments[:4]
    if kind.name != ("torch", "FloatStorage"):
        raise PolicyFileError(f"its weights are {kind.name[1]}, and not 32 bits wide")
    numbers = np.frombuffer(read(f"{folder}data/{key}"), "<f4")
    end = offset + sum((n - 1) * step for n, step in zip(shape, strides, strict=True)) + 1
    if offset < 0 or min(strides, default=0) < 0 or end > len(numbers):
        raise PolicyFileError("its weights lie outside what is stored")
    places = [4 * step for step in strides]
    return np.lib.stride_tricks.as_strided(numbers[offset:], tuple(shape), places)
