"""The actor's architecture, as the policy's class and keyword arguments in `data` give it."""

from __future__ import annotations

import math
import re
from typing import Any

from ....policy.network import ACTIVATIONS
from ...error import DAMAGED, RETRAIN, PolicyFileError
from .algorithms import Actor, actor_of
from .data import Json, printed_class, section

_FLATTEN = "<class 'stable_baselines3.common.torch_layers.FlattenExtractor'>"
_CLIP_MEAN = 2.0

_READ_KWARGS = {
    "activation_fn",
    "clip_mean",
    "features_extractor_class",
    "n_quantiles",
    "net_arch",
    "squash_output",
    "use_sde",
}
_IRRELEVANT_KWARGS = {
    "device",
    "features_extractor_kwargs",
    "full_std",
    "log_std_init",
    "n_critics",
    "normalize_images",
    "optimizer_class",
    "optimizer_kwargs",
    "ortho_init",
    "sde_net_arch",
    "share_features_extractor",
    "use_expln",
}
_INIT_TEXT = re.compile(r"<function ([\w.<>]+)\.__init__ at ")


def actor_class(data: Json) -> Actor:
    """Where the policy's class keeps its actor.

    Raises:
        PolicyFileError: for a class that is not read.
    """
    described = section(data, "policy_class")
    module = str(described.get("__module__", "an unknown module"))
    init = _INIT_TEXT.match(str(described.get("__init__", "")))
    return actor_of(module, init.group(1) if init else "a class without a readable name")


def policy_kwargs(data: Json) -> Json:
    """`policy_kwargs`, refused if one of them is not known to be harmless to the action."""
    described = section(data, "policy_kwargs")
    kwargs = {key: value for key, value in described.items() if not key.startswith(":")}
    unknown = sorted(set(kwargs) - _READ_KWARGS - _IRRELEVANT_KWARGS)
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
    module, _, name = printed_class(text).rpartition(".")
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


def uses_gsde(data: Json) -> bool:
    """Whether the policy explores with gSDE."""
    used = data.get("use_sde", False)
    if not isinstance(used, bool):
        raise PolicyFileError(f"use_sde={used!r} is not a setting of stable-baselines3; {DAMAGED}")
    return used


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
    """Size that outputs are limited to before tanh; infinity without a limit."""
    if actor.last != "actor.mu" or not uses_gsde(data):
        return math.inf
    limit = kwargs.get("clip_mean", _CLIP_MEAN)
    if isinstance(limit, bool) or not isinstance(limit, int | float) or not math.isfinite(limit):
        raise PolicyFileError(f"clip_mean={limit!r} is not a number; {DAMAGED}")
    return float(limit) if limit > 0 else math.inf


def quantile_count(kwargs: Json, actor: Actor) -> int:
    """Outputs of the network for each output that counts, which is their mean."""
    count = kwargs.get("n_quantiles", actor.quantiles) if actor.quantiles else 1
    if type(count) is not int or count < 1:
        raise PolicyFileError(f"n_quantiles={count!r} is not a whole number above 0; {DAMAGED}")
    return count
