"""The actor's architecture, as the policy's class and keyword arguments in `data` give it."""

from __future__ import annotations

import re

from ...policy import ACTIVATIONS
from ..error import DAMAGED, RETRAIN, PolicyFileError
from .data import Json, printed_class, section

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
_INIT_TEXT = re.compile(r"<function ([\w.<>]+)\.__init__ at ")


def check_policy_class(data: Json) -> None:
    """Refuse every policy class but the feed-forward actor-critic of PPO and A2C."""
    described = section(data, "policy_class")
    module = str(described.get("__module__", "an unknown module"))
    init = _INIT_TEXT.match(str(described.get("__init__", "")))
    name = init.group(1) if init else "a class without a readable name"
    if (module, name) != (_POLICY_MODULE, _POLICY_CLASS):
        raise PolicyFileError(
            f"the policy class is {name} of {module}, and only PPO's and A2C's {_POLICY_CLASS} "
            f"('MlpPolicy') can be read; {RETRAIN}"
        )


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


def activation_name(kwargs: Json) -> str:
    """Name of the activation; SB3's default is Tanh."""
    if "activation_fn" not in kwargs:
        return _DEFAULT_ACTIVATION
    text = str(kwargs["activation_fn"])
    module, _, name = printed_class(text).rpartition(".")
    if module != "torch.nn.modules.activation" or name not in ACTIVATIONS:
        raise PolicyFileError(
            f"the activation function {text} is not known; "
            f"{RETRAIN} with one of torch.nn's {', '.join(sorted(ACTIVATIONS))}"
        )
    return name


def hidden_sizes(kwargs: Json) -> tuple[int, ...]:
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
            f"{RETRAIN} with plain integers such as dict(pi=[64, 64], vf=[64, 64])"
        )
    return tuple(arch)


def squashed(data: Json, kwargs: Json) -> bool:
    """Whether actions pass through tanh, which SB3 does with gSDE only."""
    squash, use_sde = kwargs.get("squash_output", False), data.get("use_sde", False)
    if not isinstance(squash, bool) or not isinstance(use_sde, bool) or (squash and not use_sde):
        raise PolicyFileError(
            f"squash_output={squash!r} with use_sde={use_sde!r} is not a setting of "
            f"stable-baselines3; {DAMAGED}"
        )
    return squash
