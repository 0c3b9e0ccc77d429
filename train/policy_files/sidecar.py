"""The files of a trained policy: SB3's zip, its actor as `safetensors`, and a JSON side-car.

The side-car says how the policy came about. It is written last, so a policy without one is not
finished; and it holds the policy's content hash and one of its own, so that files that do not
belong together and edits are found out.
"""

from __future__ import annotations

import io
import json
import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from gymnasium import spaces

from integ_gym.support import read_json, read_object, replace_file

from ..policy import MlpPolicy
from .error import PolicyFileError
from .onnx_file import OnnxPolicy
from .own_hash import FORMAT, UNHASHED_FORMAT, check_own_hash, hashed
from .reading import read_weights
from .safetensors_file import safetensors_bytes
from .sb3_zip import read_archive

POLICY_FILE = "policy.zip"
WEIGHTS_FILE = "policy.safetensors"
SIDECAR_FILE = "policy.json"

_RESTORE = "keep the side-car beside the policy it was written with, or train it again"
_REWRITE = "restore it from a copy, or say what is right with integ_gym.write_sidecar"


@dataclass(frozen=True)
class TrainedPolicy:
    """A finished policy on disk.

    Attributes:
        policy: path of the SB3 zip.
        sidecar: path of the JSON beside it.
        card: content of the side-car.
    """

    policy: Path
    sidecar: Path
    card: Mapping[str, Any]

    @property
    def content_hash(self) -> str:
        """Hash of everything that decides the actions; see `MlpPolicy.content_hash`."""
        return str(self.card["content_hash"])


def check_folder(out_dir: str | os.PathLike[str], force: bool) -> Path:
    """The folder for a policy, which need not be there yet.

    Raises:
        OSError: if it is a file; or, unless ``force``, if there is a policy in it.
    """
    folder = Path(out_dir)
    held = [name for name in (POLICY_FILE, SIDECAR_FILE) if (folder / name).exists()]
    if held and not force:
        raise FileExistsError(
            f"{folder} already holds {' and '.join(held)}; give another folder, or --force "
            "(force=True) to replace the policy"
        )
    if folder.exists() and not folder.is_dir():
        raise NotADirectoryError(f"{folder} is a file; give a folder for the policy")
    return folder


def write_policy(
    out_dir: Path, zip_bytes: bytes, card: Mapping[str, Any], action_space: spaces.Space[Any]
) -> TrainedPolicy:
    """Write a policy and its side-car, each file in one step, the side-car last.

    A process killed in between leaves no file half-written and no side-car beside a zip that it
    does not describe. ``format``, ``policy_file``, ``weights_file``, ``content_hash`` and
    ``action_bounds`` are added to the card from the zip itself, and ``card_hash`` from all of it.

    Args:
        out_dir: folder that exists; a policy in it is replaced.
        zip_bytes: what SB3 saved.
        card: JSON-serialisable, without NaN or infinity.
        action_space: that the policy was trained in.

    Raises:
        ValueError: if the policy cannot be read back, for example because its weights are not
            finite, or if the card is not JSON.
    """
    zip_path, sidecar_path = out_dir / POLICY_FILE, out_dir / SIDECAR_FILE
    bounds = _bounds(action_space)
    try:
        policy = read_archive(io.BytesIO(zip_bytes), zip_path.stem, None, bounds)
    except ValueError as error:
        raise PolicyFileError(f"training left a policy that cannot be used: {error}") from error
    full = hashed(
        {
            "format": FORMAT,
            "policy_file": POLICY_FILE,
            "weights_file": WEIGHTS_FILE,
            "content_hash": policy.content_hash,
            "action_bounds": bounds,
            **card,
        }
    )
    text = json.dumps(full, indent=2, allow_nan=False, ensure_ascii=False) + "\n"
    weights = safetensors_bytes(policy)
    sidecar_path.unlink(missing_ok=True)
    replace_file(zip_path, zip_bytes)
    replace_file(out_dir / WEIGHTS_FILE, weights)
    replace_file(sidecar_path, text.encode())
    return TrainedPolicy(zip_path, sidecar_path, full)


def has_sidecar(policy: str | os.PathLike[str]) -> bool:
    """Whether a file of the policy's name is its side-car, or a damaged one.

    JSON that says neither what format it has nor a policy's hash belongs to somebody else.
    """
    path = Path(policy).with_suffix(".json")
    if not path.exists():
        return False
    try:
        content = read_json(path, _RESTORE)
    except ValueError:
        return True
    return isinstance(content, dict) and not {"format", "content_hash"}.isdisjoint(content)


def read_sidecar(policy: str | os.PathLike[str]) -> dict[str, Any]:
    """The side-car of a policy: the JSON file of the same name.

    Raises:
        PolicyFileError: in one sentence, if it is missing, damaged or of another format.
    """
    path = Path(policy).with_suffix(".json")
    try:
        card = read_object(path, {}, _RESTORE)
    except ValueError as error:
        raise PolicyFileError(str(error)) from None
    found = card.get("format")
    if found not in (FORMAT, UNHASHED_FORMAT):
        raise PolicyFileError(
            f"{path}: has format {found!r:.60} where {FORMAT!r} was expected; "
            "give the side-car that the trainer wrote"
        )
    return card


def read_trained(
    policy: str | os.PathLike[str],
) -> tuple[MlpPolicy | OnnxPolicy, dict[str, Any]]:
    """A policy with a side-car, named as that says, and the side-car.

    Args:
        policy: path of its file.

    Raises:
        PolicyFileError: in one sentence, if a file cannot be read, the two do not belong together,
            or the side-car was edited.
    """
    card = read_sidecar(policy)
    check_own_hash(card, Path(policy).with_suffix(".json"), _REWRITE)
    bounds = card.get("action_bounds")
    if not _are_bounds(bounds):
        raise PolicyFileError(
            f"{Path(policy).with_suffix('.json')}: `action_bounds` must be null or two lists of "
            "numbers; restore the file that the trainer wrote"
        )
    read = read_weights(Path(policy), card)
    if read.content_hash != card.get("content_hash"):
        raise PolicyFileError(
            f"{policy}: is not the policy that {Path(policy).with_suffix('.json').name} describes; "
            "restore the pair, or train again"
        )
    return replace(read, policy_id=str(card.get("policy_id", read.policy_id))), card


def _bounds(action_space: spaces.Space[Any]) -> tuple[list[float], list[float]] | None:
    """(low, high) of a `Box`, in the action's units."""
    if not isinstance(action_space, spaces.Box):
        return None
    return action_space.low.tolist(), action_space.high.tolist()


def _are_bounds(value: Any) -> bool:
    """Whether a side-car's value is (low, high), or None."""
    return value is None or (
        isinstance(value, list)
        and len(value) == 2
        and all(isinstance(side, list) and side for side in value)
        and all(isinstance(x, int | float) for side in value for x in side)
    )
