"""A policy made of what the zip holds."""

from __future__ import annotations

import os
from pathlib import Path
from typing import BinaryIO

from numpy.typing import ArrayLike

from ...policy import MlpPolicy, ObservationStatistics
from ..error import DAMAGED, PolicyFileError
from .architecture import activation_name, check_policy_class, hidden_sizes, policy_kwargs, squashed
from .data import parse_json, section
from .members import read_members
from .observation_statistics import read_observation_statistics
from .spaces import decoding, vector_size
from .weights import layers_of, load_tensors


def read_sb3_zip(
    path: str | os.PathLike[str],
    obs_stats: str | os.PathLike[str] | None = None,
    *,
    action_bounds: tuple[ArrayLike, ArrayLike] | None = None,
) -> MlpPolicy:
    """Read the actor of a PPO or A2C model with `MlpPolicy`, as `model.save(path)` wrote it.

    The file does not say whether the model was trained inside `VecNormalize`; if it was, pass
    `obs_stats`, or the policy acts on observations of the wrong scale.

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


def read_archive(
    archive: Path | BinaryIO,
    policy_id: str,
    statistics: ObservationStatistics | None,
    action_bounds: tuple[ArrayLike, ArrayLike] | None,
) -> MlpPolicy:
    """The policy in a zip of that name.

    Raises:
        ValueError: what is wrong with the zip or the policy, without a file's name.
    """
    data_text, weights = read_members(archive)
    data = parse_json(data_text, f"its member 'data' {{}}; {DAMAGED}")
    check_policy_class(data)
    kwargs = policy_kwargs(data)
    inputs = vector_size(section(data, "observation_space"), "observation space")
    activation, hidden = activation_name(kwargs), hidden_sizes(kwargs)
    actions = decoding(section(data, "action_space"), squashed(data, kwargs), action_bounds)
    layers = layers_of(load_tensors(weights), (inputs, *hidden, actions.size))
    return MlpPolicy(layers, activation, actions, statistics, policy_id)
