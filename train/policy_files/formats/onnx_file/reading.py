"""A policy and its metadata out of an ONNX file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from integ_gym.support.files.reading import parse_json, read_bounded
from integ_gym.support.packages.extras import load

from ....policy.mlp_policy import MlpPolicy
from ...error import PolicyFileError
from ...own_hash import check_own_hash
from .chain import NotAChain, steps_of
from .network import policy_of
from .packages import FORMAT, METADATA, onnx
from .runtime_policy import OnnxPolicy

MAX_BYTES = 512 * 2**20
"""Largest file that is read."""

_PROBES, _TOLERANCE = 16, 1e-4


def read_onnx(path: Path) -> MlpPolicy | OnnxPolicy:
    """The policy of a file: our own where its graph is a feed-forward network.

    Raises:
        PolicyFileError: in one sentence, if it cannot be read.
        ModuleNotFoundError: if the extra is missing, with the command that installs it.
    """
    content, model = _loaded(path)
    run = OnnxPolicy(content, policy_id=path.stem)
    try:
        policy = policy_of(steps_of(model.graph), path.stem)
    except NotAChain:
        return run
    return policy if _same(policy, run) else run


def _same(policy: MlpPolicy, run: OnnxPolicy) -> bool:
    """Whether our own reading of a graph does what onnxruntime does."""
    observations = np.random.default_rng(0).normal(size=(_PROBES, *policy.observation_shape))
    try:
        own, given = policy.act(observations), run.outputs(observations)
    except PolicyFileError:
        raise
    except Exception:  # a graph of fixed shape or another type; what is read here has none
        return False
    return bool(np.allclose(own.reshape(given.shape), given, _TOLERANCE, _TOLERANCE))


def onnx_card(path: Path) -> dict[str, Any] | None:
    """What a file's metadata says, as a side-car does; None without any of ours.

    Raises:
        PolicyFileError: in one sentence, if it cannot be read or was edited.
    """
    _, model = _loaded(path)
    for prop in model.metadata_props:
        if prop.key == METADATA:
            try:
                card = parse_json(prop.value.encode())
            except ValueError:
                card = None
            if not isinstance(card, dict) or card.get("format") != FORMAT:
                raise PolicyFileError(
                    f"{path}: its metadata `{METADATA}` is not of format {FORMAT!r}; write the "
                    "file again with integ_gym.save_policy"
                )
            check_own_hash(card, path, "write the file again with integ_gym.save_policy")
            return card
    return None


def onnx_data(path: Path) -> list[Path]:
    """Files beside an ONNX file that hold its weights, which are its own wherever it is kept.

    Raises:
        PolicyFileError: in one sentence, if it cannot be read.
    """
    helper = load("onnx.external_data_helper", "onnx")
    tensors = _parsed(path)[1].graph.initializer
    apart = {helper.ExternalDataInfo(one).location for one in tensors if one.external_data}
    return [path.parent / place for place in sorted(apart)]


def _loaded(path: Path) -> tuple[bytes, Any]:
    content, model = _parsed(path)
    apart = [tensor for tensor in model.graph.initializer if tensor.external_data]
    if not apart:
        return content, model
    _join(path, apart)
    return model.SerializeToString(), model


def _parsed(path: Path) -> tuple[bytes, Any]:
    """A file's bytes and its graph, weights beside it left there."""
    try:
        content = read_bounded(path, MAX_BYTES)
    except OSError as error:
        raise PolicyFileError(
            f"{path}: cannot be opened ({error.strerror}); check the path"
        ) from error
    except ValueError as error:
        raise PolicyFileError(f"{error}; give a smaller network") from None
    try:
        model = onnx().load_model_from_string(content)
    except ModuleNotFoundError:
        raise
    except Exception as error:  # a damaged file can fail in any way inside protobuf
        raise PolicyFileError(f"{path}: is not a readable ONNX file; export it again") from error
    return content, model


def _join(path: Path, tensors: list[Any]) -> None:
    """Read weights that are kept beside the file, as torch exports them.

    Raises:
        PolicyFileError: in one sentence, if they lie elsewhere, are missing or too large.
    """
    helper = load("onnx.external_data_helper", "onnx")
    places = {helper.ExternalDataInfo(tensor).location for tensor in tensors}
    for place in sorted(places):
        beside = path.parent / place
        if Path(place).name != place or beside.is_symlink() or not beside.is_file():
            raise PolicyFileError(
                f"{path}: keeps its weights in {place!r}, which is no file beside it; move them "
                "together, or export it as one file"
            )
    if sum((path.parent / place).stat().st_size for place in places) > MAX_BYTES:
        raise PolicyFileError(
            f"{path}: its weights are larger than {MAX_BYTES} bytes; give a smaller network"
        )
    try:
        for tensor in tensors:
            helper.load_external_data_for_tensor(tensor, str(path.parent))
    except Exception as error:  # a damaged file can fail in any way inside the reader
        raise PolicyFileError(
            f"{path}: the weights beside it do not fit it; export both again"
        ) from error
