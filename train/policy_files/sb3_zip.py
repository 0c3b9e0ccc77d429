"""Policies in stable-baselines3's zip files, read without executing them."""

from __future__ import annotations

import base64
import io
import math
import os
import re
import zipfile
from collections.abc import Callable, Mapping
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any, BinaryIO, Literal, TypeAlias

import numpy as np
from gymnasium import spaces
from numpy.typing import ArrayLike

from integ_gym.support.errors import InputError
from integ_gym.support.files import check_regular, read_bounded
from integ_gym.support.parameters import is_number

from ..policy import (
    BoxActions,
    DiscreteActions,
    FloatArray,
    MlpPolicy,
    ObservationStatistics,
    expand_bound,
)
from . import card, sb3_weights
from .card import DAMAGED, PolicyFileError
from .pickles import looks_pickled, read_number_type, read_vec_normalize

_PASS_BOUNDS = "pass action_bounds=(low, high)"
_NUMBER_TEXT = re.compile(r"[-+]?(?:inf|\d+\.(?P<decimals>\d*)(?P<exponent>e[-+]\d+)?)")


def _space_kind(space: sb3_weights.Json) -> str:
    """Class name of a Gymnasium (or Gym) space, for example `Box`."""
    text = str(space.get(":type:", "a space without a readable type"))
    parts = sb3_weights.parse_class_name(text).split(".")
    return parts[-1] if parts[:2] in (["gymnasium", "spaces"], ["gym", "spaces"]) else text


def box_size(space: sb3_weights.Json, what: str) -> int:
    """How many numbers a `Box` has, which SB3 flattens; a message calls it ``what``."""
    kind, shape = _space_kind(space), _shape(space)
    sizes = shape if isinstance(shape, list) else []
    if kind != "Box" or not sizes or not all(type(n) is int and n > 0 for n in sizes):
        raise PolicyFileError(
            f"the {what} is {kind} of shape {shape}, and only a Box"
            f"{' or Discrete' if what == 'action space' else ''} can be read; "
            "flatten the environment's space and train again"
        )
    return math.prod(sizes)


def _shape(space: sb3_weights.Json) -> Any:
    """Of a space: files that were written under gym store ``shape``, later ones ``_shape``."""
    return space.get("_shape", space.get("shape"))


def make_decoder(
    space: sb3_weights.Json,
    squash: bool,
    action_bounds: tuple[ArrayLike, ArrayLike] | None,
    limit: float = math.inf,
) -> BoxActions | DiscreteActions:
    """How outputs become actions of this space."""
    if _space_kind(space) == "Discrete":
        return _discrete_actions(space, squash, action_bounds)
    size = box_size(space, "action space")
    if space.get("dtype") != "float32":
        raise PolicyFileError(
            f"the action space has dtype {space.get('dtype')}, and only float32 can be read; "
            "train in an environment with a float32 Box"
        )
    if action_bounds is None:
        low, high = (_parse_bound(space, name, size) for name in ("low", "high"))
    else:
        low, high = (expand_bound(bound, size) for bound in action_bounds)
    actions = BoxActions(low, high, squash, limit)
    if actions.size != size:
        raise PolicyFileError(
            f"action_bounds have length {actions.size} and the action space {size}; "
            "pass one number per action"
        )
    return actions


def _discrete_actions(
    space: sb3_weights.Json, squash: bool, action_bounds: tuple[ArrayLike, ArrayLike] | None
) -> DiscreteActions:
    """A `Discrete` space that counts from 0."""
    n, start = str(space.get("n")), str(space.get("start", "0"))
    if not re.fullmatch(r"[1-9]\d{0,8}", n) or start != "0":
        raise PolicyFileError(
            f"the action space Discrete(n={n}, start={start}) cannot be read, because "
            "stable-baselines3 counts actions from 0; train in an environment with start=0"
        )
    if squash or action_bounds is not None:
        raise PolicyFileError(
            f"the action space Discrete({n}) has no bounds; "
            "leave out squash_output and action_bounds"
        )
    return DiscreteActions(int(n))


def _parse_bound(space: sb3_weights.Json, name: str, size: int) -> FloatArray:
    """A bound from the text NumPy printed for it, float32 of shape (size,).

    NumPy prints eight decimals. From 0.125 up that settles a float32; below, a number of more than
    six decimals may have been rounded and is refused. (Shorter ones are what somebody typed.)
    """
    text = str(space.get(name))
    words = text.replace("[", " ").replace("]", " ").split()
    numbers = [_NUMBER_TEXT.fullmatch(word) for word in words]
    ends = len(_shape(space))
    opened, closed = len(text) - len(text.lstrip("[")), len(text) - len(text.rstrip("]"))
    line = " ".join(text.split())
    shortened = line if len(line) <= 60 else f"{line[:57]}..."
    whole = opened == closed == ends
    if not whole or len(numbers) != size or not all(numbers):
        raise PolicyFileError(
            f"the action space's bound '{name}' is printed as {shortened}, which does not "
            f"spell out {size} numbers; {_PASS_BOUNDS}"
        )
    for number in filter(None, numbers):
        decimals = number.group("decimals") or ""
        small = abs(float(number.group())) < 0.125
        if not number.group("exponent") and len(decimals) > 6 and small:
            raise PolicyFileError(
                f"the action space's bound '{name}' is printed as {number.group()}, which may be "
                f"rounded; {_PASS_BOUNDS}"
            )
    with np.errstate(over="ignore"):
        return np.array([float(word) for word in words]).astype(np.float32)


_OFF_POLICY = "buffer_size"
"""Algorithms with a replay buffer keep raw observations outside `VecNormalize` as well."""


_DEFAULTS = {"epsilon": 1e-8, "clip_obs": 10.0}
"""Of `VecNormalize`, and of CleanRL's scripts."""

GivenStatistics: TypeAlias = (
    str | os.PathLike[str] | Mapping[str, Any] | ObservationStatistics | Literal[False] | None
)
"""Statistics as people give them: a file, ``{"mean": …, "var": …}``, or False where the policy
learned from observations as they are; None: nothing is said."""


def observation_statistics_of(given: GivenStatistics) -> ObservationStatistics | None:
    """Statistics that were given in one of these ways; None where observations are not normalized.

    Raises:
        PolicyFileError: in one sentence, for a file that cannot be read, or wrong values.
    """
    if given is None or given is False or isinstance(given, ObservationStatistics):
        return given or None
    if not isinstance(given, Mapping):
        return read_observation_statistics(given)
    try:
        lists = {name: np.ravel(given[name]).tolist() for name in ("mean", "var") if name in given}
        return _statistics({**given, **lists})
    except ValueError as error:
        raise PolicyFileError(
            f'obs_stats: {error}; give {{"mean": …, "var": …}} with one number per observation'
        ) from error


def read_observation_statistics(path: str | os.PathLike[str]) -> ObservationStatistics | None:
    """Read observation statistics; None where observations are not normalized.

    The file is the `vecnormalize.pkl` that `VecNormalize.save(path)` wrote, of which nothing is
    executed; or JSON with the keys of
    `{"mean": [...], "var": [...], "epsilon": 1e-8, "clip_obs": 10.0}`, which are `obs_rms.mean`,
    `obs_rms.var`, `epsilon` and `clip_obs` of a `VecNormalize`; the last two are these numbers
    where they are left out.

    Raises:
        PolicyFileError: in one sentence, if the file is missing, malformed or has wrong values.
    """
    file = Path(path)
    remedy = (
        'give the file of VecNormalize.save(path), or write {"mean": [...], "var": [...], '
        '"epsilon": 1e-8, "clip_obs": 10.0} with the numbers of the VecNormalize used in training'
    )
    try:
        content = read_bounded(file, card.MAX_JSON_BYTES)
        if looks_pickled(content):
            return read_vec_normalize(content)
        return _statistics(sb3_weights.json_object(content, "the file {}"))
    except OSError as error:
        reason = f"cannot be opened ({error.strerror})"
        raise PolicyFileError(f"{file}: {reason}; {remedy}") from error
    except ValueError as error:
        raise PolicyFileError(f"{file}: {error}; {remedy}") from error


def _statistics(fields: sb3_weights.Json) -> ObservationStatistics:
    """Statistics from parsed JSON; raises ValueError with what is wrong."""
    if not {"mean", "var"} <= set(fields) <= {"mean", "var", *_DEFAULTS}:
        raise InputError(
            "expected the keys mean, var and perhaps epsilon, clip_obs, got "
            f"{', '.join(sorted(map(str, fields)))}"
        )
    fields = {**_DEFAULTS, **fields}
    for name in ("mean", "var"):
        if not isinstance(fields[name], list) or not all(map(_is_number, fields[name])):
            raise InputError(f"'{name}' must be a list of finite numbers")
    for name in ("epsilon", "clip_obs"):
        if not _is_number(fields[name]):
            raise InputError(f"'{name}' must be a finite number, got {fields[name]!r}")
    return ObservationStatistics(**fields)


def _is_number(value: Any) -> bool:
    """Whether a JSON value is a number that a float can hold."""
    try:
        return is_number(value) and math.isfinite(value)
    except OverflowError:
        return False


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
        space = model.action_space
        box = isinstance(space, spaces.Box)
        bounds = (space.low.ravel(), space.high.ravel()) if box else None
        return read_archive(content, policy_id, statistics, bounds)
    except (AttributeError, ValueError) as error:
        raise PolicyFileError(f"the model {policy_id}: {error}") from error


def is_scaled(archive: Path | BinaryIO) -> bool:
    """Whether the model in a zip was trained inside `VecNormalize`, as far as that shows.

    Scaled observations are float32, which tells where the environment's are float64. Where these
    are float32 too, on-policy algorithms keep raw ones inside `VecNormalize` alone, be it one with
    ``norm_obs=False``, and of off-policy algorithms it does not show.

    Raises:
        PolicyFileError: in one sentence, if it cannot be read.
    """
    data, _ = _read_members(archive)
    raw = data.get("_last_original_obs")
    if raw is None:
        return False
    before, after = _find_number_type(raw), _find_number_type(data.get("_last_obs"))
    if before and after and before != after:
        return True
    return _OFF_POLICY not in data and before != "f8"


def _find_number_type(described: Any) -> str | None:
    """Type of a saved array's numbers, such as `f4`; None for what is no such array."""
    text = described.get(":serialized:") if isinstance(described, dict) else None
    try:
        return read_number_type(base64.b64decode(str(text), validate=True))
    except ValueError:
        return None


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


def read_archive(
    archive: Path | BinaryIO,
    policy_id: str,
    statistics: ObservationStatistics | None,
    action_bounds: tuple[ArrayLike, ArrayLike] | None,
    load: Callable[[bytes], Mapping[str, Any]] = sb3_weights.load_tensors,
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
    data, weights = _read_members(archive)
    actor, kwargs = sb3_weights.actor_class(data), sb3_weights.policy_kwargs(data)
    inputs = box_size(sb3_weights.section(data, "observation_space"), "observation space")
    activation = sb3_weights.activation_name(kwargs, actor)
    squash = sb3_weights.squashed(data, kwargs, actor)
    limit = sb3_weights.mean_limit(data, kwargs, actor)
    actions = make_decoder(sb3_weights.section(data, "action_space"), squash, action_bounds, limit)
    if actor.discrete not in (None, isinstance(actions, DiscreteActions)):
        raise PolicyFileError(
            f"the action space {actions} is none that {actor.algorithms[0]} can have; {DAMAGED}"
        )
    tensors = load(weights)
    shared, own = sb3_weights.hidden_sizes(
        kwargs, actor, any(name.startswith(sb3_weights.SHARED) for name in tensors)
    )
    names = actor.names(len(shared), len(own), limit < math.inf)
    quantiles = sb3_weights.quantile_count(kwargs, actor)
    sizes = (inputs, *shared, *own, quantiles * actions.size)
    layers = sb3_weights.layers_of(
        tensors, dict(zip(names, pairwise(sizes), strict=True)), actor.unused
    )
    return MlpPolicy(
        sb3_weights.average_quantiles(layers, quantiles), activation, actions, statistics, policy_id
    )


def _read_members(file: Path | BinaryIO) -> tuple[sb3_weights.Json, bytes]:
    """What `data` says, and the bytes of `policy.pth`, checked for presence and size."""
    try:
        if isinstance(file, Path):
            check_regular(file)
        with zipfile.ZipFile(file) as archive:
            data = read_member(archive, "data", card.MAX_JSON_BYTES)
            weights = read_member(archive, "policy.pth", card.MAX_WEIGHTS_BYTES)
        return sb3_weights.json_object(data, f"its member 'data' {{}}; {DAMAGED}"), weights
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
