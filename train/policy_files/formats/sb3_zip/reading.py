"""A policy made of what the zip holds, whose members are read only if not too large."""

from __future__ import annotations

import io
import math
import os
import zipfile
from collections.abc import Callable, Mapping
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any, BinaryIO

from gymnasium import spaces
from numpy.typing import ArrayLike

from integ_gym.support.files import check_regular

from ....policy.actions import BoxActions, DiscreteActions
from ....policy.mlp_policy import MlpPolicy
from ....policy.observation_statistics import ObservationStatistics
from ...error import DAMAGED, PolicyFileError
from . import limits
from .algorithms import SHARED, Actor
from .architecture import (
    activation_name,
    actor_class,
    hidden_sizes,
    mean_limit,
    policy_kwargs,
    quantile_count,
    squashed,
)
from .data import Json, json_object, section
from .observation_statistics import read_observation_statistics
from .scaling import learned_scaled
from .spaces import box_size, decoding
from .weights import averaged, layers_of, load_tensors

_PACKED = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
"""Of these a piece unpacks to no more than was asked for."""

_PIECE = 1 << 20
"""Bytes."""


def read_sb3_zip(
    path: str | os.PathLike[str],
    obs_stats: str | os.PathLike[str] | None = None,
    *,
    action_bounds: tuple[ArrayLike, ArrayLike] | None = None,
) -> MlpPolicy:
    """Read the deterministic actor of a model with `MlpPolicy`, as `model.save(path)` wrote it.

    Of PPO, A2C, SAC, TD3, DDPG and DQN of stable-baselines3 and TQC, TRPO and QR-DQN of
    sb3-contrib, of all versions since 1.0.

    The file has no statistics of a `VecNormalize`; of a model that was trained inside one, pass
    `obs_stats`, or the policy acts on observations of the wrong scale; see :func:`is_scaled`.

    Args:
        path: the `.zip` file.
        obs_stats: JSON file of observation statistics, see `read_observation_statistics`.
        action_bounds: (low, high), each of shape (action_dim,) in the action's units, for the rare
            file whose printed bounds are shortened or rounded; otherwise the file's own are used.

    Returns:
        The policy, named after the file. It acts as `model.predict(obs, deterministic=True)`.

    Raises:
        PolicyFileError: in one sentence, if anything in the file is damaged, unknown or unsafe.
        ImportError: in one line, if torch is not installed.
    """
    statistics = None if obs_stats is None else read_observation_statistics(obs_stats)
    file = Path(path)
    try:
        return read_archive(file, file.stem, statistics, action_bounds)
    except ValueError as error:
        raise PolicyFileError(f"{file}: {error}") from error


def read_sb3_model(model: Any, policy_id: str) -> MlpPolicy:
    """The actor of a model in memory, as :func:`read_sb3_zip` would read its file.

    Statistics of a `VecNormalize` that the model's environment has are taken with it.

    Args:
        model: of stable-baselines3 or sb3-contrib.
        policy_id: its name.

    Raises:
        PolicyFileError: in one sentence, if it cannot be read.
    """
    content = io.BytesIO()
    model.save(content)
    normalize = model.get_vec_normalize_env()
    try:
        statistics = None
        if normalize is not None and normalize.norm_obs:
            own, limits_of = normalize.obs_rms, (normalize.epsilon, normalize.clip_obs)
            statistics = ObservationStatistics(own.mean, own.var, *limits_of)
        return read_archive(content, policy_id, statistics, _bounds(model.action_space))
    except (AttributeError, ValueError) as error:
        raise PolicyFileError(f"the model {policy_id}: {error}") from error


def is_scaled(archive: Path | BinaryIO) -> bool:
    """Whether the model in a zip was trained inside `VecNormalize`, as far as that shows.

    Raises:
        PolicyFileError: in one sentence, if it cannot be read.
    """
    data_text, _ = _read_members(archive)
    return learned_scaled(_data(data_text))


def lacks_statistics(model: Any) -> bool:
    """Whether a model in memory was trained inside `VecNormalize` and is without one now.

    Args:
        model: of stable-baselines3 or sb3-contrib.
    """
    if model.get_vec_normalize_env() is not None:
        return False
    content = io.BytesIO()
    model.save(content)
    return is_scaled(content)


def _bounds(space: Any) -> tuple[ArrayLike, ArrayLike] | None:
    return (space.low.ravel(), space.high.ravel()) if isinstance(space, spaces.Box) else None


def read_archive(
    archive: Path | BinaryIO,
    policy_id: str,
    statistics: ObservationStatistics | None,
    action_bounds: tuple[ArrayLike, ArrayLike] | None,
    load: Callable[[bytes], Mapping[str, Any]] = load_tensors,
) -> MlpPolicy:
    """The policy in a zip of that name.

    Args:
        archive: the zip.
        policy_id: its name.
        statistics: of observations, which the zip has not.
        action_bounds: see :func:`read_sb3_zip`.
        load: reads the weights; by default torch does.

    Raises:
        ValueError: what is wrong with the zip or the policy, without a file's name.
    """
    data_text, weights = _read_members(archive)
    data = _data(data_text)
    actor, kwargs = actor_class(data), policy_kwargs(data)
    inputs = box_size(section(data, "observation_space"), "observation space")
    activation, squash = activation_name(kwargs, actor), squashed(data, kwargs, actor)
    limit = mean_limit(data, kwargs, actor)
    actions = decoding(section(data, "action_space"), squash, action_bounds, limit)
    _check_kind(actions, actor)
    tensors = load(weights)
    shared, own = hidden_sizes(kwargs, actor, any(name.startswith(SHARED) for name in tensors))
    names = actor.names(len(shared), len(own), limit < math.inf)
    quantiles = quantile_count(kwargs, actor)
    sizes = (inputs, *shared, *own, quantiles * actions.size)
    layers = layers_of(tensors, dict(zip(names, pairwise(sizes), strict=True)), actor.unused)
    return MlpPolicy(averaged(layers, quantiles), activation, actions, statistics, policy_id)


def _data(content: bytes) -> Json:
    return json_object(content, f"its member 'data' {{}}; {DAMAGED}")


def _check_kind(actions: BoxActions | DiscreteActions, actor: Actor) -> None:
    if actor.discrete is None or actor.discrete == isinstance(actions, DiscreteActions):
        return
    raise PolicyFileError(
        f"the action space {actions} is none that {actor.algorithms[0]} can have; {DAMAGED}"
    )


def _read_members(file: Path | BinaryIO) -> tuple[bytes, bytes]:
    """The bytes of `data` and `policy.pth`, checked for presence and size."""
    try:
        if isinstance(file, Path):
            check_regular(file)
        with zipfile.ZipFile(file) as archive:
            return (
                read_member(archive, "data", limits.MAX_JSON_BYTES),
                read_member(archive, "policy.pth", limits.MAX_WEIGHTS_BYTES),
            )
    except PolicyFileError:
        raise
    except zipfile.BadZipFile as error:
        raise PolicyFileError(f"is not a complete zip file; {DAMAGED}, or copy it again") from error
    except OSError as error:
        raise PolicyFileError(
            f"cannot be opened ({error.strerror or error}); check the path"
        ) from error
    except Exception as error:  # a damaged archive can fail in any way inside zipfile and zlib
        raise PolicyFileError(f"cannot be unpacked ({type(error).__name__}); {DAMAGED}") from error


def read_member(archive: zipfile.ZipFile, name: str, limit: int) -> bytes:
    """One member, refused above `limit` bytes before more than that is unpacked."""
    try:
        info = archive.getinfo(name)
    except KeyError:
        raise PolicyFileError(
            f"has no member '{name}', so it is not a model saved by stable-baselines3; "
            "give the .zip that model.save(path) wrote"
        ) from None
    if info.file_size > limit:
        raise PolicyFileError(
            f"has a member '{name}' of {info.file_size} bytes, above the limit of {limit}; "
            "give a model with a smaller network"
        )
    if info.compress_type not in _PACKED:
        raise PolicyFileError(
            f"has a member '{name}' packed in a way that model.save(path) does not use; {DAMAGED}"
        )
    with archive.open(info) as member:  # in pieces: a whole reading unpacks beyond what is declared
        return b"".join(iter(partial(member.read, _PIECE), b""))
