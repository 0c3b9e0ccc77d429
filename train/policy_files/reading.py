"""What is wrong with a policy's files, and what to do about one that is refused."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any
from zipfile import is_zipfile

from ..policy import MlpPolicy, ObservationStatistics
from .limits import PolicyFileError
from .onnx import OnnxPolicy, read_onnx
from .safetensors_file import read_safetensors
from .sb3_zip import GivenStatistics, is_scaled, observation_statistics_of, read_sb3_zip
from .state_dict import STATE_DICT_ENDINGS, normalizes, read_state_dict

ONNX_ENDING, SAFETENSORS_ENDING = ".onnx", ".safetensors"
POLICY_ENDINGS = (".zip", ONNX_ENDING, *STATE_DICT_ENDINGS, SAFETENSORS_ENDING)
"""Of the files that are read; where several hold one policy, the first is the one to read."""

_PICKLES = (".pkl", ".pickle", ".joblib", ".cloudpickle", ".dill")
_WAY = (
    "export the actor with torch.onnx.export, save it with integ_gym.save_policy, or judge it from "
    "Python: integ_gym.evaluate(policy, env_id, out)"
)


def read_weights(
    path: Path, card: Mapping[str, Any] | None = None, obs_stats: GivenStatistics = None
) -> MlpPolicy | OnnxPolicy:
    """The policy of a file, without what a side-car says of its training.

    Args:
        path: a zip of stable-baselines3 or sb3-contrib, ``.safetensors``, ``.onnx``, or a state
            dict: ``.pt``, ``.pth`` or ``.cleanrl_model``.
        card: content of its side-car.
        obs_stats: statistics of its observations; by default those that the side-car holds.

    Raises:
        PolicyFileError: in one sentence, for a file that cannot be read without executing
            something, with the way that works.
    """
    told = card or {}
    network = told.get("network") or {}
    policy = _read(path, network, told.get("action_bounds"))
    statistics = _statistics(network) if obs_stats is None else observation_statistics_of(obs_stats)
    if statistics is None:
        if obs_stats is False and getattr(policy, "statistics", None) is not None:
            raise PolicyFileError(f"{path}: holds statistics of its own; leave out obs_stats=False")
        return policy
    return _with(policy, statistics, path)


def unscaled(path: Path, card: Mapping[str, Any] | None = None) -> bool:
    """Whether a policy learned from scaled observations, and its files lack their statistics.

    Args:
        path: of a file that :func:`read_weights` reads.
        card: content of its side-car.
    """
    suffix, network = path.suffix.lower(), (card or {}).get("network") or {}
    if suffix in (ONNX_ENDING, SAFETENSORS_ENDING):
        return False
    if network.get("observation_statistics") is not None or network.get("scaled") is False:
        return False
    return normalizes(path) if suffix in STATE_DICT_ENDINGS else is_scaled(path)


def _read(path: Path, network: Mapping[str, Any], bounds: Any) -> MlpPolicy | OnnxPolicy:
    suffix = path.suffix.lower()
    _check_file(path)
    if suffix == SAFETENSORS_ENDING:
        return read_safetensors(path)
    if suffix == ONNX_ENDING:
        return read_onnx(path)
    if suffix in _PICKLES:
        raise PolicyFileError(
            f"{path}: is a pickle, which runs what it holds when it is read; {_WAY}"
        )
    if suffix in STATE_DICT_ENDINGS:
        return read_state_dict(path, {"action_bounds": bounds, **network})
    return read_sb3_zip(path, action_bounds=bounds)


def _check_file(path: Path) -> None:
    """Refuse what is no policy's file by its name, with what may have been meant.

    Raises:
        PolicyFileError: in one sentence.
    """
    if path.is_dir():
        held = [path / f"policy{ending}" for ending in POLICY_ENDINGS]
        found = next((str(file) for file in held if file.exists()), "the file of a policy in it")
        raise PolicyFileError(f"{path}: is a folder; give {found}")
    if not path.exists() and path.suffix.lower() not in POLICY_ENDINGS:
        held = [path.with_name(path.name + ending) for ending in POLICY_ENDINGS]
        found = next((f"give {file}" for file in held if file.exists()), "")
        raise PolicyFileError(
            f"{path}: there is no such file; "
            f"{found or 'give a file, or a function of your own as --policy MODULE:FUNCTION'}"
        )
    known = path.suffix.lower() in (*POLICY_ENDINGS, *_PICKLES)
    if not known and path.is_file() and not is_zipfile(path):
        raise PolicyFileError(
            f"{path}: its ending says no format that is read, which are "
            f"{', '.join(POLICY_ENDINGS)}; name it by its format, or {_WAY}"
        )


def _statistics(network: Mapping[str, Any]) -> ObservationStatistics | None:
    given = network.get("observation_statistics")
    try:
        return None if given is None else ObservationStatistics(**given)
    except (TypeError, ValueError) as error:
        raise PolicyFileError(
            f"the side-car's observation statistics cannot be read ({error}); write it again"
        ) from error


def _with(
    policy: MlpPolicy | OnnxPolicy, statistics: ObservationStatistics, path: Path
) -> MlpPolicy | OnnxPolicy:
    try:
        return replace(policy, statistics=statistics)
    except ValueError as error:
        raise PolicyFileError(f"{path}: {error}") from error
