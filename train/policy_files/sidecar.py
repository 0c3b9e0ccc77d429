"""The home of a policy as people state it."""

from __future__ import annotations

import hashlib
import io
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeAlias

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from integ_gym.envs.environment import is_integ_environment
from integ_gym.envs.settings import DISCRETIZATION, Discretization
from integ_gym.envs.testbeds.gym_testbed import Testbed
from integ_gym.envs.testbeds.making import find_testbed
from integ_gym.support.errors import InputError
from integ_gym.support.files import file_hash, read_json, read_object, replace_file
from integ_gym.support.options import named_value
from integ_gym.support.parameters import unknown_name

from ..policy import BoxActions, DiscreteActions, MlpPolicy
from .card import (
    FORMAT,
    UNHASHED_FORMAT,
    PolicyFileError,
    card_bytes,
    check_own_hash,
    hashed,
)
from .programs import ProgramPolicy
from .reading import read_weights
from .safetensors_file import safetensors_bytes
from .sb3_zip import read_archive

STOCK = "stock"
"""What is stated of a policy that was trained on the environment as its library makes it."""

UNKNOWN = "unknown"
"""What is stated of a policy about which no more is known; the same as nothing."""

STOCK_ARGUMENTS: Mapping[str, Mapping[str, Any]] = {
    "IntegPendulum-v0": {"max_speed": 8.0},
    "IntegCartPole-v0": {},
    "IntegAcrobot-v0": {},
}
"""What makes an environment Gymnasium's own at its default discretization."""

Stated: TypeAlias = str | Mapping[str, Any] | Discretization | None
"""A home as people state it: ``"integrator=…,dt=…,control_period=…"``, the same as a mapping or a
`Discretization`, ``"stock"`` or ``"unknown"``; a control period alone leaves the rest unknown."""


def how_to_state(env_id: str) -> str:
    """What to type of a home that is not known."""
    stock = "" if _is_ours_alone(env_id) else " or --home stock"
    return f"state it with --home integrator=…,dt=…,control_period=…{stock}"


def _is_ours_alone(env_id: str) -> bool:
    return is_integ_environment(env_id) and env_id not in STOCK_ARGUMENTS


def stated_arguments(
    stated: Stated, env_id: str, environment: Mapping[str, Any] = MappingProxyType({})
) -> dict[str, Any]:
    """A stated home as constructor arguments of the training environment.

    Args:
        stated: the home.
        env_id: environment.
        environment: other arguments, without which a testbed of the user's own may have no home.

    Raises:
        ValueError: for what is no home, in one sentence.
    """
    if stated is None or stated == UNKNOWN:
        return {}

    def testbed() -> Testbed:
        return find_testbed(env_id, environment if ":" in env_id else {})

    if stated == STOCK:
        if _is_ours_alone(env_id):
            raise InputError(
                f"{env_id} is no environment of Gymnasium's, so --home stock says nothing; give "
                "--home integrator=…,dt=…,control_period=…"
            )
        return {**testbed().home.arguments(), **STOCK_ARGUMENTS.get(env_id, {})}
    parts = read_place(stated)
    if parts is None:
        raise InputError(
            f"the home {stated!r} cannot be read; give integrator=…,dt=…,control_period=…, or "
            f"{STOCK!r} for what was trained on the environment as its library makes it"
        )
    for name in parts:
        if name not in DISCRETIZATION:
            raise InputError(unknown_name("part of a home", name, DISCRETIZATION))
    if set(parts) == {"control_period"}:
        return parts
    lacking = [name for name in ("integrator", "dt") if name not in parts]
    if lacking:
        raise InputError(
            f"the home lacks `{lacking[0]}`; give --home integrator=…,dt=…,control_period=…, or "
            "control_period=… alone where no more is known"
        )
    fixed = testbed().control_period
    period = parts["dt"] if fixed is None else fixed
    return {"engine": testbed().home.engine, "control_period": period, **parts}


def read_place(place: str | Mapping[str, Any] | Discretization) -> dict[str, Any] | None:
    """A home or a cell as people state it, as constructor arguments; None if it cannot be read."""
    if isinstance(place, Discretization):
        return place.arguments()
    if isinstance(place, Mapping):
        return dict(place)
    words = [word.strip() for word in place.split(",")]
    return dict(map(named_value, words)) if all("=" in word for word in words) else None


POLICY_FILE = "policy.zip"
WEIGHTS_FILE = "policy.safetensors"
SIDECAR_FILE = "policy.json"
_ZIP_HASH = "zip_hash"
_FILES = (POLICY_FILE, WEIGHTS_FILE, SIDECAR_FILE)

_RESTORE = (
    "keep the side-car beside the policy it was written with, or write one with "
    "integ_gym.write_sidecar"
)
_REWRITE = "restore it from a copy, or say what is right with integ_gym.write_sidecar"


@dataclass(frozen=True)
class TrainedPolicy:
    """A finished policy on disk.

    Attributes:
        policy: path of the file that the side-car names: SB3's zip, or without one the weights.
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
    held = [name for name in _FILES if (folder / name).exists()]
    if held and not force:
        raise FileExistsError(
            f"{folder} already holds {', '.join(held)}; give another folder, or --force "
            "(force=True) to replace the policy"
        )
    if folder.exists() and not folder.is_dir():
        raise NotADirectoryError(f"{folder} is a file; give a folder for the policy")
    return folder


def write_policy(
    out_dir: Path, zip_bytes: bytes, card: Mapping[str, Any], action_space: spaces.Space[Any]
) -> TrainedPolicy:
    """Write a policy that SB3 saved: its zip, its actor and a side-car; see :func:`write_actor`.

    Raises:
        PolicyFileError: if the policy cannot be read back, for example because its weights are not
            finite.
        ValueError: if the card is not JSON.
    """
    bounds = _bounds(action_space)
    with _usable():
        policy = read_archive(io.BytesIO(zip_bytes), Path(POLICY_FILE).stem, None, bounds)
    return write_actor(out_dir, policy, card, action_space, zip_bytes)


def write_actor(
    out_dir: Path,
    policy: MlpPolicy,
    card: Mapping[str, Any],
    action_space: spaces.Space[Any],
    zip_bytes: bytes | None = None,
) -> TrainedPolicy:
    """Write a policy and its side-car, each file in one step, the side-car last.

    A process killed in between leaves no file half-written and no side-car beside a policy that it
    does not describe. ``format``, ``policy_file``, ``weights_file``, ``content_hash``,
    ``action_bounds`` and, of a zip, ``zip_hash`` are added to the card, and ``card_hash`` from all
    of it.

    Args:
        out_dir: folder that exists; a policy in it is replaced.
        policy: the actor.
        card: JSON-serialisable, without NaN or infinity.
        action_space: that the policy was trained in.
        zip_bytes: the same policy as SB3 saves it.

    Raises:
        ValueError: if the card is not JSON.
    """
    own = {
        "format": FORMAT,
        "policy_file": WEIGHTS_FILE if zip_bytes is None else POLICY_FILE,
        "weights_file": WEIGHTS_FILE,
        "content_hash": policy.content_hash,
        "action_bounds": _bounds(action_space),
    }
    if zip_bytes is not None:
        own[_ZIP_HASH] = hashlib.sha256(zip_bytes).hexdigest()
    full = hashed({**own, **card})
    content, weights = card_bytes(full), safetensors_bytes(policy)
    (out_dir / SIDECAR_FILE).unlink(missing_ok=True)
    if zip_bytes is None:
        (out_dir / POLICY_FILE).unlink(missing_ok=True)
    else:
        replace_file(out_dir / POLICY_FILE, zip_bytes)
    replace_file(out_dir / WEIGHTS_FILE, weights)
    replace_file(out_dir / SIDECAR_FILE, content)
    return TrainedPolicy(out_dir / str(full["policy_file"]), out_dir / SIDECAR_FILE, full)


def actor_of(
    weights: Mapping[str, NDArray[np.float32]],
    hidden: int,
    activation: str,
    action_space: spaces.Space[Any],
) -> MlpPolicy:
    """The actor among an actor-critic's weights.

    Args:
        weights: by SB3's names.
        hidden: number of the network's hidden layers.
        activation: name of the torch class.
        action_space: that the policy was trained in.

    Raises:
        PolicyFileError: if it cannot be used, for example because its weights are not finite.
    """
    names = [f"mlp_extractor.policy_net.{2 * layer}" for layer in range(hidden)] + ["action_net"]
    layers = tuple((weights[f"{name}.weight"], weights[f"{name}.bias"]) for name in names)
    with _usable():
        actions = (
            BoxActions(action_space.low, action_space.high)
            if isinstance(action_space, spaces.Box)
            else DiscreteActions(len(layers[-1][1]))
        )
        return MlpPolicy(layers, activation, actions, None, Path(WEIGHTS_FILE).stem)


@contextmanager
def _usable() -> Iterator[None]:
    """What is wrong with a policy after its training, said as that."""
    try:
        yield
    except ValueError as error:
        raise PolicyFileError(f"training left a policy that cannot be used: {error}") from error


def policy_file(folder: Path) -> Path:
    """The file of the policy in a folder: what its side-car names, or else the zip."""
    named = _read_sidecar(folder).get("policy_file")
    return folder / (named if named in (POLICY_FILE, WEIGHTS_FILE) else POLICY_FILE)


def readable_file(folder: Path) -> Path:
    """The file to read the policy in a folder from: one that does without torch, if there is one.

    The weights stand for the zip where the side-car's hash says that it is the one written with
    them.
    """
    file, weights = policy_file(folder), folder / WEIGHTS_FILE
    stated = _read_sidecar(folder).get(_ZIP_HASH)
    if file == weights or stated is None or not (weights.exists() and file.exists()):
        return file
    return weights if file_hash(file) == stated else file


def _read_sidecar(folder: Path) -> dict[str, Any]:
    """What the side-car in a folder says; nothing where there is none, or a damaged one."""
    with suppress(ValueError, OSError):
        return read_object(folder / SIDECAR_FILE, {}, _RESTORE)
    return {}


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
) -> tuple[MlpPolicy | ProgramPolicy, dict[str, Any]]:
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
    return action_space.low.ravel().tolist(), action_space.high.ravel().tolist()


def _are_bounds(value: Any) -> bool:
    """Whether a side-car's value is (low, high), or None."""
    return value is None or (
        isinstance(value, list)
        and len(value) == 2
        and all(isinstance(side, list) and side for side in value)
        and all(isinstance(x, int | float) for side in value for x in side)
    )
