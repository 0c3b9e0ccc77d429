"""A policy made of what the zip holds."""

from __future__ import annotations

import os
from pathlib import Path

from numpy.typing import ArrayLike

from ...policy import MlpPolicy, ObservationStatistics
from ..error import PolicyFileError
from .architecture import activation_name, check_policy_class, hidden_sizes, policy_kwargs, squashed
from .data import Json, parse_json, section
from .members import read_members
from .observation_statistics import read_observation_statistics
from .remedies import DAMAGED
from .spaces import decoding, observation_size
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
        data_text, weights = read_members(file)
        data = parse_json(data_text, f"its member 'data' {{}}; {DAMAGED}")
        return _build(file.stem, data, weights, statistics, action_bounds)
    except PolicyFileError as error:
        raise PolicyFileError(f"{file}: {error}") from error


def _build(
    policy_id: str,
    data: Json,
    weights: bytes,
    statistics: ObservationStatistics | None,
    action_bounds: tuple[ArrayLike, ArrayLike] | None,
) -> MlpPolicy:
    """The policy that the readable part of `data` describes, with the weights filled in."""
    check_policy_class(data)
    kwargs = policy_kwargs(data)
    inputs = observation_size(section(data, "observation_space"))
    activation, hidden = activation_name(kwargs), hidden_sizes(kwargs)
    squash = squashed(data, kwargs)
    try:
        actions = decoding(section(data, "action_space"), squash, action_bounds)
        sizes = (inputs, *hidden, actions.size)
        layers = layers_of(load_tensors(weights), sizes)
        return MlpPolicy(layers, activation, actions, statistics, policy_id)
    except PolicyFileError:
        raise
    except ValueError as error:  # a check of MlpPolicy or of one of its parts
        raise PolicyFileError(str(error)) from error
