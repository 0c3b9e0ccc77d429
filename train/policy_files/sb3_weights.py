"""The networks of stable-baselines3's algorithms, from their weights' names and shapes."""

from __future__ import annotations

import io
import json
import math
import pickletools
import re
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from integ_gym.support.optional import missing_package

from ..policy import ACTIVATIONS, Layer
from . import card
from .card import DAMAGED, RETRAIN, PolicyFileError

Json: TypeAlias = Mapping[str, Any]

SHARED = "mlp_extractor.shared_net"
"""Layers that actor and critic have in common, in files of before 1.8."""

_OFF_POLICY = ("critic.", "critic_target.")


@dataclass(frozen=True)
class Actor:
    """Where a policy class keeps its actor, and what it defaults to.

    Attributes:
        algorithms: that have it.
        hidden: name of the network of hidden layers in the state dict; each is followed by an
            activation.
        last: name of the last layer; None where it is the network's own last.
        unused: beginnings of the names of weights that decide no deterministic action.
        activation: default, the name of the torch class.
        sizes: default sizes of the hidden layers.
        squash: whether its actions always pass through tanh; None: as `squash_output` says.
        discrete: whether it chooses among a `Discrete` space; None: either.
        quantiles: default number of quantiles, whose mean is an action's value; 0: none.
    """

    algorithms: tuple[str, ...]
    hidden: str
    last: str | None
    unused: tuple[str, ...]
    activation: str = "ReLU"
    sizes: tuple[int, ...] = (256, 256)
    squash: bool | None = True
    discrete: bool | None = False
    quantiles: int = 0

    def names(self, shared: int, own: int, gsde: bool) -> Sequence[str]:
        """Names of the layers, input first.

        Args:
            shared: number of layers that actor and critic have in common.
            own: number of the actor's own hidden layers.
            gsde: whether a limit of gSDE's mean follows the last.
        """
        hidden = [f"{SHARED}.{2 * k}" for k in range(shared)]
        hidden += [f"{self.hidden}.{2 * k}" for k in range(own)]
        if self.last is None:
            return [*hidden, f"{self.hidden}.{2 * own}"]
        return [*hidden, f"{self.last}.0" if gsde else self.last]


_SB3, _CONTRIB = "stable_baselines3", "sb3_contrib"
_GAUSSIAN = ("actor.latent_pi", "actor.mu", (*_OFF_POLICY, "actor.log_std"))
_VALUES: Json = {"sizes": (64, 64), "squash": False, "discrete": True}

ACTORS = {
    (f"{_SB3}.common.policies", "ActorCriticPolicy"): Actor(
        ("PPO", "A2C", "TRPO"), "mlp_extractor.policy_net", "action_net",
        ("mlp_extractor.value_net.", "value_net.", "log_std"),
        activation="Tanh", sizes=(64, 64), squash=None, discrete=None,
    ),
    (f"{_SB3}.sac.policies", "SACPolicy"): Actor(("SAC",), *_GAUSSIAN),
    (f"{_CONTRIB}.tqc.policies", "TQCPolicy"): Actor(("TQC",), *_GAUSSIAN),
    (f"{_SB3}.td3.policies", "TD3Policy"): Actor(
        ("TD3", "DDPG"), "actor.mu", None, (*_OFF_POLICY, "actor_target."), sizes=(400, 300)
    ),
    (f"{_SB3}.dqn.policies", "DQNPolicy"): Actor(
        ("DQN",), "q_net.q_net", None, ("q_net_target.",), **_VALUES
    ),
    (f"{_CONTRIB}.qrdqn.policies", "QRDQNPolicy"): Actor(
        ("QR-DQN",), "quantile_net.quantile_net", None, ("quantile_net_target.",),
        quantiles=200, **_VALUES,
    ),
}  # fmt: skip
"""Module and name of a policy class to its actor."""

_FLATTEN = f"<class '{_SB3}.common.torch_layers.FlattenExtractor'>"
_CLIP_MEAN = 2.0
_KNOWN_KWARGS = {
    *("activation_fn", "clip_mean", "features_extractor_class", "n_quantiles", "net_arch"),
    *("squash_output", "use_sde"),
    *("device", "features_extractor_kwargs", "full_std", "log_std_init", "n_critics"),
    *("normalize_images", "optimizer_class", "optimizer_kwargs", "ortho_init", "sde_net_arch"),
    *("share_features_extractor", "use_expln"),
}
"""Of a policy: those that are read, and those that decide no action."""

_INIT_TEXT = re.compile(r"<function ([\w.<>]+)\.__init__ at ")


def actor_class(data: Json) -> Actor:
    """Where the policy's class keeps its actor.

    Raises:
        PolicyFileError: for a class that is not read, with the way that works.
    """
    described = section(data, "policy_class")
    module = str(described.get("__module__", "an unknown module"))
    init = _INIT_TEXT.match(str(described.get("__init__", "")))
    name = init.group(1) if init else "a class without a readable name"
    if (module, name) in ACTORS:
        return ACTORS[module, name]
    known = ", ".join(algorithm for actor in ACTORS.values() for algorithm in actor.algorithms)
    way = "judge the loaded model from Python with integ_gym.evaluate(model, env_id, out); or"
    raise PolicyFileError(
        f"the policy class is {name} of {module}, and only the 'MlpPolicy' of {known} can be read; "
        f"{way} {RETRAIN}"
    )


def policy_kwargs(data: Json) -> Json:
    """`policy_kwargs`, refused if one of them is not known to be harmless to the action."""
    described = section(data, "policy_kwargs")
    kwargs = {key: value for key, value in described.items() if not key.startswith(":")}
    unknown = sorted(set(kwargs) - _KNOWN_KWARGS)
    if unknown:
        raise PolicyFileError(
            f"the policy_kwargs {', '.join(map(repr, unknown))} are not known; "
            f"{RETRAIN} without them"
        )
    extractor = kwargs.get("features_extractor_class", _FLATTEN)
    if extractor != _FLATTEN:
        raise PolicyFileError(
            f"the features extractor {extractor} cannot be read, only FlattenExtractor; "
            f"{RETRAIN} without 'features_extractor_class'"
        )
    return kwargs


def activation_name(kwargs: Json, actor: Actor) -> str:
    """Name of the activation."""
    if "activation_fn" not in kwargs:
        return actor.activation
    text = str(kwargs["activation_fn"])
    module, _, name = parse_class_name(text).rpartition(".")
    if module != "torch.nn.modules.activation" or name not in ACTIVATIONS:
        raise PolicyFileError(
            f"the activation function {text} is not known; "
            f"{RETRAIN} with one of torch.nn's {', '.join(sorted(ACTIVATIONS))}"
        )
    return name


def hidden_sizes(
    kwargs: Json, actor: Actor, shared: bool = False
) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Sizes of the layers that the actor shares with the critic, and of its own hidden ones.

    Args:
        kwargs: of the policy.
        actor: its class's.
        shared: whether there are such layers, which numbers in a list meant before 1.8.
    """
    saved = arch = kwargs.get("net_arch")
    if arch is None:
        return (), actor.sizes
    common: list[Any] = []
    if isinstance(arch, list) and arch and isinstance(arch[-1], dict):
        if shared or len(arch) == 1:
            common, arch = arch[:-1], arch[-1]  # the spelling of SB3 before 1.8
    elif shared and isinstance(arch, list):
        common, arch = arch, []
    if isinstance(arch, dict):
        arch = arch.get("pi", [])
    every = [*common, *arch] if isinstance(arch, list) else [None]
    if not all(type(n) is int and n > 0 for n in every):
        raise PolicyFileError(
            f"the net_arch {saved!r} cannot be read; "
            f"{RETRAIN} with plain integers such as dict(pi=[64, 64], vf=[64, 64])"
        )
    return tuple(common), tuple(arch)


def squashed(data: Json, kwargs: Json, actor: Actor) -> bool:
    """Whether actions pass through tanh, which PPO and A2C do with gSDE only."""
    if actor.squash is not None:
        return actor.squash
    squash, use_sde = kwargs.get("squash_output", False), data.get("use_sde", False)
    if not isinstance(squash, bool) or not isinstance(use_sde, bool) or (squash and not use_sde):
        raise PolicyFileError(
            f"squash_output={squash!r} with use_sde={use_sde!r} is not a setting of "
            f"stable-baselines3; {DAMAGED}"
        )
    return squash


def mean_limit(data: Json, kwargs: Json, actor: Actor) -> float:
    """Size that outputs are limited to before tanh, as with gSDE; infinity without a limit."""
    used, limit = data.get("use_sde", False), kwargs.get("clip_mean", _CLIP_MEAN)
    if actor.last != "actor.mu":
        return math.inf
    if not isinstance(used, bool):
        raise PolicyFileError(f"use_sde={used!r} is not a setting of stable-baselines3; {DAMAGED}")
    if used and not (type(limit) in (int, float) and math.isfinite(limit)):
        raise PolicyFileError(f"clip_mean={limit!r} is not a number; {DAMAGED}")
    return float(limit) if used and limit > 0 else math.inf


def quantile_count(kwargs: Json, actor: Actor) -> int:
    """Outputs of the network for each output that counts, which is their mean."""
    count = kwargs.get("n_quantiles", actor.quantiles) if actor.quantiles else 1
    if type(count) is not int or count < 1:
        raise PolicyFileError(f"n_quantiles={count!r} is not a whole number above 0; {DAMAGED}")
    return count


_RSL_RL = ("actor_state_dict", "model_state_dict")
"""What a checkpoint of rsl_rl calls the network, since 4.0 and before."""

_OLD_FORMAT = b"\x80\x02\x8a\x0al\xfc\x9cF\xf9 j\xa8P\x19."
"""How a file begins that torch before 1.6 wrote: its magic number, pickled."""

_OLD_PICKLES = 4
"""What follows, each a pickle, before the numbers: version, machine, object, names of storages."""


def load_tensors(
    content: bytes, what: str = "its member 'policy.pth'", remedy: str = ""
) -> Mapping[str, Any]:
    """A state dict, by torch's reader that builds tensors and nothing else.

    Of several in a tuple, as CleanRL saves actor and critics, the first is the actor's.

    Args:
        content: of the file, in torch's zip format or its older one.
        what: a message calls it.
        remedy: what helps where it holds something else, of a file that is no zip of SB3's.

    Raises:
        PolicyFileError: in one sentence, for anything else.
        ModuleNotFoundError: without torch.
    """
    try:
        import torch
    except ImportError:
        raise missing_package("torch", "train") from None
    if content.startswith(_OLD_FORMAT):
        _check_old_format(content, what)
    else:
        _check_archive(content, what)
    try:
        tensors = torch.load(io.BytesIO(content), map_location="cpu", weights_only=True)
    except Exception as error:  # hostile or damaged bytes can fail in any way inside torch
        raise PolicyFileError(
            f"{what} holds something other than plain weights; {remedy or DAMAGED}"
        ) from error
    if isinstance(tensors, tuple) and tensors:
        tensors = tensors[0]
    if isinstance(tensors, dict) and any(isinstance(part, dict) for part in tensors.values()):
        names = ", ".join(str(name) for name in list(tensors)[:6])
        kind = f"is the checkpoint of a training, with the parts {names}; {remedy or RETRAIN}"
        if any(name in tensors for name in _RSL_RL):
            kind = (
                "is a checkpoint of rsl_rl, which does not say how its network is built; export it "
                'to ONNX with runner.export_policy_to_onnx("exported") and give '
                "exported/policy.onnx"
            )
        elif isinstance(tensors.get("policy"), dict):
            kind = (
                "is a checkpoint of skrl, which does not say how its network is built; export "
                "agent.policy behind its preprocessor of observations with torch.onnx.export"
            )
        raise PolicyFileError(f"{what} {kind}")
    if not isinstance(tensors, dict) or not all(
        isinstance(name, str)
        and isinstance(tensor, torch.Tensor)
        and tensor.layout is torch.strided
        and tensor.dtype is torch.float32
        and tensor.device.type == "cpu"
        for name, tensor in tensors.items()
    ):
        raise PolicyFileError(
            f"{what} holds something other than float32 weights; {remedy or RETRAIN}"
        )
    return tensors


def _check_old_format(content: bytes, what: str) -> None:
    """Refuse weights in torch's older format that would take more memory than the limit."""
    stream = io.BytesIO(content[len(_OLD_FORMAT) :])
    try:
        read = [step for _ in range(_OLD_PICKLES) for step in pickletools.genops(stream)]
    except Exception as error:  # damaged bytes can fail in any way
        raise PolicyFileError(f"{what} is not a whole file of torch; {DAMAGED}") from error
    largest = max((given for _, given, _ in read if isinstance(given, int)), default=0)
    storages = sum(opcode.name in ("PERSID", "BINPERSID") for opcode, _, _ in read)
    if 4 * largest * max(1, storages) > card.MAX_WEIGHTS_BYTES:
        raise PolicyFileError(
            f"{what} asks for more memory than the limit of {card.MAX_WEIGHTS_BYTES} bytes; "
            "give a model with a smaller network"
        )


def _check_archive(content: bytes, what: str) -> None:
    """Refuse weights that are not torch's zip format, or unpack to more than the limit."""
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            members = archive.infolist()
    except Exception as error:  # a damaged archive can fail in any way
        raise PolicyFileError(f"{what} is no file that torch.save wrote; {DAMAGED}") from error
    if any(Path(member.filename).name == "constants.pkl" for member in members):
        raise PolicyFileError(
            f"{what} is a TorchScript program, which is never run; export it with "
            "torch.onnx.export, or save the state_dict alone"
        )
    unpacked = sum(member.file_size for member in members)
    if unpacked > card.MAX_WEIGHTS_BYTES:
        raise PolicyFileError(
            f"{what} unpacks to {unpacked} bytes, above the limit of "
            f"{card.MAX_WEIGHTS_BYTES}; give a model with a smaller network"
        )


def layers_of(
    tensors: Mapping[str, Any], layers: Mapping[str, tuple[int, int]], unused: tuple[str, ...]
) -> tuple[Layer, ...]:
    """The actor's layers, checked name by name and shape by shape.

    Args:
        tensors: the state dict.
        layers: inputs and outputs of each by its name, input first.
        unused: beginnings of the names of other weights.
    """
    sizes = tuple(after for _, after in layers.values())[:-1]
    expected = {
        f"{name}.{part}": shape
        for name, (before, after) in layers.items()
        for part, shape in (("weight", (after, before)), ("bias", (after,)))
    }
    for name in tensors:
        if name not in expected and not name.startswith(unused):
            raise PolicyFileError(
                f"the weights '{name}' have no place in the saved architecture {sizes}; {DAMAGED}"
            )
    for name, shape in expected.items():
        found = tuple(tensors[name].shape) if name in tensors else "none"
        if found != shape:
            raise PolicyFileError(
                f"the weights '{name}' should have shape {shape} for the saved architecture "
                f"{sizes} and have {found}; {DAMAGED}"
            )
    if 4 * sum(math.prod(shape) for shape in expected.values()) > card.MAX_WEIGHTS_BYTES:
        raise PolicyFileError(
            f"the actor needs more than {card.MAX_WEIGHTS_BYTES} bytes; "
            "give a model with a smaller network"
        )
    return tuple(
        (np.asarray(tensors[f"{name}.weight"]), np.asarray(tensors[f"{name}.bias"]))
        for name in layers
    )


def average_quantiles(layers: tuple[Layer, ...], quantiles: int) -> tuple[Layer, ...]:
    """The same network with the mean over quantiles, which come first, as its outputs."""
    if quantiles == 1:
        return layers
    *hidden, (weight, bias) = layers
    actions = len(bias) // quantiles
    mean = (
        weight.reshape(quantiles, actions, -1).mean(axis=0, dtype=np.float64),
        bias.reshape(quantiles, actions).mean(axis=0, dtype=np.float64),
    )
    return (*hidden, (mean[0].astype(np.float32), mean[1].astype(np.float32)))


_CLASS_TEXT = re.compile(r"<class '([\w.]+)'>")


def json_object(content: bytes, sentence: str) -> Json:
    """A JSON object, whose numbers may be infinite as those of models are.

    Raises:
        PolicyFileError: on anything else, with `sentence`, completed by the defect.
    """
    try:
        parsed = json.loads(content.decode("utf-8"))
    except (ValueError, RecursionError) as error:
        raise PolicyFileError(sentence.format("is not readable JSON")) from error
    if not isinstance(parsed, dict):
        raise PolicyFileError(sentence.format("is not a JSON object"))
    return parsed


def section(data: Json, name: str) -> Json:
    """A member of `data` that must be an object."""
    found = data.get(name)
    if not isinstance(found, dict):
        raise PolicyFileError(f"its 'data' has no readable '{name}'; {DAMAGED}")
    return found


def parse_class_name(text: str) -> str:
    """The dotted name of a class that was printed as ``<class '…'>``; empty for another text."""
    found = _CLASS_TEXT.fullmatch(text)
    return found.group(1) if found else ""
