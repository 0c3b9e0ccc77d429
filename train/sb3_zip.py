"""Read a policy that stable-baselines3 (SB3) saved, without executing anything stored in it.

SB3's own `load` unpickles arbitrary objects from the member `data`, so opening a stranger's file
runs a stranger's program. Here the weights come from `policy.pth` through torch's restricted
reader (`weights_only=True`), and the architecture, the activation and the spaces from the readable
half of the JSON in `data`; the pickled half is never decoded. What the readable half does not
settle is refused, never guessed. SB3 itself is not needed.
"""

from __future__ import annotations

import io
import json
import math
import os
import re
import zipfile
from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from integ_gym.envs.extras import missing
from integ_gym.train.policy import (
    ACTIVATIONS,
    BoxActions,
    DiscreteActions,
    FloatArray,
    Layer,
    MlpPolicy,
    ObservationStatistics,
)

Json: TypeAlias = Mapping[str, Any]

#: Largest `policy.pth` that is read, in bytes, also after unpacking (256 MiB).
MAX_WEIGHTS_BYTES = 256 * 2**20
#: Largest `data` member and largest statistics file that are read, in bytes (16 MiB).
MAX_JSON_BYTES = 16 * 2**20

_RETRAIN = "train with PPO('MlpPolicy', ...) and save again"
_DAMAGED = "save it again with model.save(path)"
_PASS_BOUNDS = "pass action_bounds=(low, high)"

_POLICY_MODULE = "stable_baselines3.common.policies"
_POLICY_CLASS = "ActorCriticPolicy"
_FLATTEN = "<class 'stable_baselines3.common.torch_layers.FlattenExtractor'>"
_DEFAULT_ACTIVATION = "Tanh"
_DEFAULT_HIDDEN = (64, 64)

_READ_KWARGS = {"net_arch", "activation_fn", "squash_output", "features_extractor_class"}
_IRRELEVANT_KWARGS = {
    "device",
    "features_extractor_kwargs",
    "full_std",
    "log_std_init",
    "normalize_images",
    "optimizer_class",
    "optimizer_kwargs",
    "ortho_init",
    "share_features_extractor",
    "use_expln",
}
_UNUSED_WEIGHTS = ("mlp_extractor.value_net.", "value_net.", "log_std")

_CLASS_TEXT = re.compile(r"<class '([\w.]+)'>")
_INIT_TEXT = re.compile(r"<function ([\w.<>]+)\.__init__ at ")
_NUMBER_TEXT = re.compile(r"[-+]?(?:inf|\d+\.(?P<decimals>\d*)(?P<exponent>e[-+]\d+)?)")


class PolicyFileError(ValueError):
    """A policy file, or a statistics file, that cannot be read safely; one sentence says why."""


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
        data_text, weights = _read_members(file)
        data = _parse_json(data_text, f"its member 'data' {{}}; {_DAMAGED}")
        return _build(file.stem, data, weights, statistics, action_bounds)
    except PolicyFileError as error:
        raise PolicyFileError(f"{file}: {error}") from error


def read_observation_statistics(path: str | os.PathLike[str]) -> ObservationStatistics:
    """Read observation statistics from JSON.

    The file holds exactly the keys of
    `{"mean": [...], "var": [...], "epsilon": 1e-8, "clip_obs": 10.0}`, which are `obs_rms.mean`,
    `obs_rms.var`, `epsilon` and `clip_obs` of a `VecNormalize`.

    Raises:
        PolicyFileError: in one sentence, if the file is missing, malformed or has wrong values.
    """
    file = Path(path)
    remedy = (
        'write {"mean": [...], "var": [...], "epsilon": 1e-8, "clip_obs": 10.0} '
        "with the numbers of the VecNormalize used in training"
    )
    try:
        return _statistics(_parse_json(_read_small_file(file), "the file {}"))
    except ValueError as error:
        raise PolicyFileError(f"{file}: {error}; {remedy}") from error


def _read_small_file(file: Path) -> bytes:
    """The bytes of a file of at most `MAX_JSON_BYTES`."""
    try:
        with file.open("rb") as stream:
            content = stream.read(MAX_JSON_BYTES + 1)
    except OSError as error:
        raise PolicyFileError(f"cannot be opened ({error.strerror})") from error
    if len(content) > MAX_JSON_BYTES:
        raise PolicyFileError(f"is larger than {MAX_JSON_BYTES} bytes")
    return content


def _statistics(fields: Json) -> ObservationStatistics:
    """Statistics from parsed JSON; raises ValueError with what is wrong."""
    expected = {"mean", "var", "epsilon", "clip_obs"}
    if set(fields) != expected:
        raise ValueError(
            f"expected the keys {', '.join(sorted(expected))}, got {', '.join(sorted(fields))}"
        )
    for name in ("mean", "var"):
        if not isinstance(fields[name], list) or not all(map(_is_number, fields[name])):
            raise ValueError(f"'{name}' must be a list of finite numbers")
    for name in ("epsilon", "clip_obs"):
        if not _is_number(fields[name]):
            raise ValueError(f"'{name}' must be a finite number, got {fields[name]!r}")
    return ObservationStatistics(**fields)


def _is_number(value: object) -> bool:
    """Whether a JSON value is a number that a float can hold."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    try:
        return math.isfinite(value)
    except OverflowError:
        return False


def _read_members(file: Path) -> tuple[bytes, bytes]:
    """The bytes of `data` and `policy.pth`, checked for presence and size."""
    try:
        with zipfile.ZipFile(file) as archive:
            return (
                _read_member(archive, "data", MAX_JSON_BYTES),
                _read_member(archive, "policy.pth", MAX_WEIGHTS_BYTES),
            )
    except PolicyFileError:
        raise
    except zipfile.BadZipFile as error:
        raise PolicyFileError(
            f"is not a complete zip file; {_DAMAGED}, or copy it again"
        ) from error
    except OSError as error:
        raise PolicyFileError(
            f"cannot be opened ({error.strerror or error}); check the path"
        ) from error
    except Exception as error:  # a damaged archive can fail in any way inside zipfile and zlib
        raise PolicyFileError(f"cannot be unpacked ({type(error).__name__}); {_DAMAGED}") from error


def _read_member(archive: zipfile.ZipFile, name: str, limit: int) -> bytes:
    """One member, refused above `limit` bytes before anything is unpacked."""
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
    return archive.read(info)


def _parse_json(content: bytes, sentence: str) -> Json:
    """A JSON object; on anything else PolicyFileError with `sentence`, completed by the defect."""
    try:
        parsed = json.loads(content.decode("utf-8"))
    except (ValueError, RecursionError) as error:
        raise PolicyFileError(sentence.format("is not readable JSON")) from error
    if not isinstance(parsed, dict):
        raise PolicyFileError(sentence.format("is not a JSON object"))
    return parsed


def _build(
    policy_id: str,
    data: Json,
    weights: bytes,
    statistics: ObservationStatistics | None,
    action_bounds: tuple[ArrayLike, ArrayLike] | None,
) -> MlpPolicy:
    """The policy that the readable part of `data` describes, with the weights filled in."""
    _check_policy_class(data)
    kwargs = _policy_kwargs(data)
    inputs = _observation_size(_section(data, "observation_space"))
    activation, hidden = _activation(kwargs), _hidden_sizes(kwargs)
    squash = _squash(data, kwargs)
    try:
        actions = _actions(_section(data, "action_space"), squash, action_bounds)
        sizes = (inputs, *hidden, actions.size)
        layers = _layers(_load_tensors(weights), sizes)
        return MlpPolicy(layers, activation, actions, statistics, policy_id)
    except PolicyFileError:
        raise
    except ValueError as error:  # a check of MlpPolicy or of one of its parts
        raise PolicyFileError(str(error)) from error


def _section(data: Json, name: str) -> Json:
    """A member of `data` that must be an object."""
    section = data.get(name)
    if not isinstance(section, dict):
        raise PolicyFileError(f"its 'data' has no readable '{name}'; {_DAMAGED}")
    return section


def _check_policy_class(data: Json) -> None:
    """Refuse every policy class but the feed-forward actor-critic of PPO and A2C."""
    section = _section(data, "policy_class")
    module = str(section.get("__module__", "an unknown module"))
    init = _INIT_TEXT.match(str(section.get("__init__", "")))
    name = init.group(1) if init else "a class without a readable name"
    if (module, name) != (_POLICY_MODULE, _POLICY_CLASS):
        raise PolicyFileError(
            f"the policy class is {name} of {module}, and only PPO's and A2C's {_POLICY_CLASS} "
            f"('MlpPolicy') can be read; {_RETRAIN}"
        )


def _policy_kwargs(data: Json) -> Json:
    """`policy_kwargs`, refused if one of them is not known to be harmless to the action."""
    section = _section(data, "policy_kwargs")
    kwargs = {key: value for key, value in section.items() if not key.startswith(":")}
    unknown = sorted(set(kwargs) - _READ_KWARGS - _IRRELEVANT_KWARGS)
    if unknown:
        raise PolicyFileError(
            f"the policy_kwargs {', '.join(map(repr, unknown))} are not known; "
            f"{_RETRAIN} without them"
        )
    extractor = kwargs.get("features_extractor_class", _FLATTEN)
    if extractor != _FLATTEN:
        raise PolicyFileError(
            f"the features extractor {extractor} cannot be read, only FlattenExtractor; "
            f"{_RETRAIN} without 'features_extractor_class'"
        )
    return kwargs


def _activation(kwargs: Json) -> str:
    """Name of the activation; SB3's default is Tanh."""
    if "activation_fn" not in kwargs:
        return _DEFAULT_ACTIVATION
    text = str(kwargs["activation_fn"])
    found = _CLASS_TEXT.fullmatch(text)
    module, _, name = found.group(1).rpartition(".") if found else ("", "", "")
    if module != "torch.nn.modules.activation" or name not in ACTIVATIONS:
        raise PolicyFileError(
            f"the activation function {text} is not known; "
            f"{_RETRAIN} with one of torch.nn's {', '.join(sorted(ACTIVATIONS))}"
        )
    return name


def _hidden_sizes(kwargs: Json) -> tuple[int, ...]:
    """Sizes of the actor's hidden layers; SB3's default is (64, 64)."""
    saved = arch = kwargs.get("net_arch")
    if arch is None:
        return _DEFAULT_HIDDEN
    if isinstance(arch, list) and len(arch) == 1 and isinstance(arch[0], dict):
        arch = arch[0]  # the spelling of SB3 before 1.8
    if isinstance(arch, dict):
        arch = arch.get("pi", [])
    if not isinstance(arch, list) or not all(type(n) is int and n > 0 for n in arch):
        raise PolicyFileError(
            f"the net_arch {saved!r} cannot be read; "
            f"{_RETRAIN} with plain integers such as dict(pi=[64, 64], vf=[64, 64])"
        )
    return tuple(arch)


def _squash(data: Json, kwargs: Json) -> bool:
    """Whether actions pass through tanh, which SB3 does with gSDE only."""
    squash, use_sde = kwargs.get("squash_output", False), data.get("use_sde", False)
    if not isinstance(squash, bool) or not isinstance(use_sde, bool) or (squash and not use_sde):
        raise PolicyFileError(
            f"squash_output={squash!r} with use_sde={use_sde!r} is not a setting of "
            f"stable-baselines3; {_DAMAGED}"
        )
    return squash


def _space_kind(space: Json) -> str:
    """Class name of a Gymnasium (or Gym) space, for example `Box`."""
    text = str(space.get(":type:", "a space without a readable type"))
    found = _CLASS_TEXT.fullmatch(text)
    parts = found.group(1).split(".") if found else []
    return parts[-1] if parts[:2] in (["gymnasium", "spaces"], ["gym", "spaces"]) else text


def _vector_size(space: Json, what: str) -> int:
    """Length of a one-dimensional `Box`."""
    kind, shape = _space_kind(space), space.get("_shape")
    sizes = shape if isinstance(shape, list) else []
    if kind != "Box" or len(sizes) != 1 or type(sizes[0]) is not int or sizes[0] < 1:
        raise PolicyFileError(
            f"the {what} is {kind} of shape {shape}, and only a one-dimensional Box"
            f"{' or Discrete' if what == 'action space' else ''} can be read; "
            "flatten the environment's space and train again"
        )
    return sizes[0]


def _observation_size(space: Json) -> int:
    """Number of observation components."""
    return _vector_size(space, "observation space")


def _actions(
    space: Json, squash: bool, action_bounds: tuple[ArrayLike, ArrayLike] | None
) -> BoxActions | DiscreteActions:
    """How outputs become actions of this space."""
    if _space_kind(space) == "Discrete":
        return _discrete_actions(space, squash, action_bounds)
    size = _vector_size(space, "action space")
    if space.get("dtype") != "float32":
        raise PolicyFileError(
            f"the action space has dtype {space.get('dtype')}, and only float32 can be read; "
            "train in an environment with a float32 Box"
        )
    if action_bounds is None:
        low, high = (_printed_bound(space, name, size) for name in ("low", "high"))
    else:
        low, high = (np.asarray(bound, dtype=np.float32) for bound in action_bounds)
    actions = BoxActions(low, high, squash)
    if actions.size != size:
        raise PolicyFileError(
            f"action_bounds have length {actions.size} and the action space {size}; "
            "pass one number per action"
        )
    return actions


def _discrete_actions(
    space: Json, squash: bool, action_bounds: tuple[ArrayLike, ArrayLike] | None
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


def _printed_bound(space: Json, name: str, size: int) -> FloatArray:
    """A bound from the text NumPy printed for it, float32 of shape (size,).

    NumPy prints eight decimals. From 0.125 up that settles a float32; below, a number of more than
    six decimals may have been rounded and is refused. (Shorter ones are what somebody typed.)
    """
    text = str(space.get(name))
    numbers = [_NUMBER_TEXT.fullmatch(word) for word in text.strip("[]").split()]
    if f"[{text.strip('[]')}]" != text or len(numbers) != size or not all(numbers):
        raise PolicyFileError(
            f"the action space's bound '{name}' is printed as {_shortened(text)}, which does not "
            f"spell out {size} numbers; {_PASS_BOUNDS}"
        )
    for number in numbers:
        if number is not None and _may_be_rounded(number):
            raise PolicyFileError(
                f"the action space's bound '{name}' is printed as {number.group()}, which may be "
                f"rounded; {_PASS_BOUNDS}"
            )
    with np.errstate(over="ignore"):
        return np.array([float(word) for word in text.strip("[]").split()]).astype(np.float32)


def _may_be_rounded(number: re.Match[str]) -> bool:
    """Whether more than one float32 is likely to be printed like this."""
    decimals = number.group("decimals") or ""
    return not number.group("exponent") and len(decimals) > 6 and abs(float(number.group())) < 0.125


def _shortened(text: str) -> str:
    """At most 60 characters of a text, on one line."""
    line = " ".join(text.split())
    return line if len(line) <= 60 else f"{line[:57]}..."


def _load_tensors(content: bytes) -> Mapping[str, Any]:
    """The state dict in `policy.pth`, by torch's reader that builds tensors and nothing else."""
    try:
        import torch
    except ImportError:
        raise missing("torch", "train") from None
    _check_archive(content)
    try:
        tensors = torch.load(io.BytesIO(content), map_location="cpu", weights_only=True)
    except Exception as error:  # hostile or damaged bytes can fail in any way inside torch
        raise PolicyFileError(
            f"its member 'policy.pth' holds something other than plain weights; {_DAMAGED}"
        ) from error
    if not isinstance(tensors, dict) or not all(
        isinstance(name, str)
        and isinstance(tensor, torch.Tensor)
        and tensor.layout is torch.strided
        and tensor.dtype is torch.float32
        and tensor.device.type == "cpu"
        for name, tensor in tensors.items()
    ):
        raise PolicyFileError(
            f"its member 'policy.pth' holds something other than float32 weights; {_RETRAIN}"
        )
    return tensors


def _check_archive(content: bytes) -> None:
    """Refuse weights that are not torch's zip format, or unpack to more than the limit."""
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            members = archive.infolist()
    except Exception as error:  # as in _read_members
        raise PolicyFileError(
            f"its member 'policy.pth' is not in torch's zip format; {_DAMAGED}"
        ) from error
    if any(Path(member.filename).name == "constants.pkl" for member in members):
        raise PolicyFileError(
            f"its member 'policy.pth' is a TorchScript program, not weights; {_DAMAGED}"
        )
    unpacked = sum(member.file_size for member in members)
    if unpacked > MAX_WEIGHTS_BYTES:
        raise PolicyFileError(
            f"its member 'policy.pth' unpacks to {unpacked} bytes, above the limit of "
            f"{MAX_WEIGHTS_BYTES}; give a model with a smaller network"
        )


def _layers(tensors: Mapping[str, Any], sizes: tuple[int, ...]) -> tuple[Layer, ...]:
    """The actor's layers, checked name by name and shape by shape.

    Args:
        tensors: the state dict.
        sizes: inputs, hidden layers, outputs.
    """
    hidden = [f"mlp_extractor.policy_net.{2 * index}" for index in range(len(sizes) - 2)]
    names = [*hidden, "action_net"]
    expected = {
        f"{name}.{part}": shape
        for name, (before, after) in zip(names, pairwise(sizes), strict=True)
        for part, shape in (("weight", (after, before)), ("bias", (after,)))
    }
    for name in tensors:
        if name not in expected and not name.startswith(_UNUSED_WEIGHTS):
            raise PolicyFileError(
                f"the weights '{name}' have no place in the saved architecture "
                f"{sizes[1:-1]}; {_DAMAGED}"
            )
    for name, shape in expected.items():
        found = tuple(tensors[name].shape) if name in tensors else "none"
        if found != shape:
            raise PolicyFileError(
                f"the weights '{name}' should have shape {shape} for the saved architecture "
                f"{sizes[1:-1]} and have {found}; {_DAMAGED}"
            )
    if 4 * sum(math.prod(shape) for shape in expected.values()) > MAX_WEIGHTS_BYTES:
        raise PolicyFileError(
            f"the actor needs more than {MAX_WEIGHTS_BYTES} bytes; "
            "give a model with a smaller network"
        )
    return tuple(
        (tensors[f"{name}.weight"].numpy(), tensors[f"{name}.bias"].numpy()) for name in names
    )
