"""Policy files whose data does not settle the policy are refused."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from gymnasium import spaces
from policy_files import UNIT_3, BoxEnv, refusal, rewritten, setting

from integ_gym.train.policy_files import sb3_weights as architecture
from integ_gym.train.policy_files.sb3_zip import read_sb3_zip

sb3 = pytest.importorskip("stable_baselines3")

TORCH_CLASS = "<class 'torch.nn.modules.activation.{}'>"


def discrete(n: str, start: str = "0", squash: bool = False) -> Callable[[dict[str, Any]], None]:
    """An edit of `data` that makes the action space Discrete."""

    def edit(data: dict[str, Any]) -> None:
        data["action_space"] = {
            ":type:": "<class 'gymnasium.spaces.discrete.Discrete'>",
            "n": n,
            "start": start,
        }
        data["use_sde"] = squash
        data["policy_kwargs"]["squash_output"] = squash

    return edit


KWARGS, BOX = "policy_kwargs", "action_space"
UNREADABLE_DATA: list[tuple[Callable[[dict[str, Any]], None], str]] = [
    (
        setting("policy_class", "__module__", to="sb3_contrib.common.recurrent.policies"),
        "ActorCriticPolicy of sb3_contrib.common.recurrent.policies, and only the 'MlpPolicy' of",
    ),
    (
        setting("policy_class", "__init__", to="<function ActorCriticCnnPolicy.__init__ at 0x1>"),
        "the policy class is ActorCriticCnnPolicy of stable_baselines3.common.policies",
    ),
    (setting("policy_class", "__init__", to=3), "a class without a readable name"),
    (setting("policy_class", to="text"), "no readable 'policy_class'"),
    (setting(KWARGS, to=None), "no readable 'policy_kwargs'"),
    (setting(KWARGS, "lstm_hidden_size", to=256), "policy_kwargs 'lstm_hidden_size' are not known"),
    (
        setting(KWARGS, "features_extractor_class", to="<class '__main__.Mine'>"),
        "features extractor <class '__main__.Mine'> cannot be read, only FlattenExtractor",
    ),
    (
        setting(KWARGS, "activation_fn", to="<class '__main__.ReLU'>"),
        "activation function <class '__main__.ReLU'> is not known",
    ),
    (setting(KWARGS, "activation_fn", to=TORCH_CLASS.format("PReLU")), "is not known; train with"),
    (setting(KWARGS, "activation_fn", to="functools.partial(<class 'x'>)"), "functools.partial"),
    (setting(KWARGS, "net_arch", to="{'pi': [np.int64(64)]}"), "the net_arch \"{'pi'"),
    (setting(KWARGS, "net_arch", to=[64, {"pi": [64]}]), "cannot be read; train with"),
    (setting(KWARGS, "net_arch", to=[64, 0]), "the net_arch [64, 0] cannot be read"),
    (setting(KWARGS, "net_arch", to={"pi": [True]}), "cannot be read"),
    (setting(KWARGS, "squash_output", to=True), "squash_output=True with use_sde=False"),
    (setting("use_sde", to="yes"), "use_sde='yes' is not a setting"),
    (setting("observation_space", to=[]), "no readable 'observation_space'"),
    (
        setting("observation_space", ":type:", to="<class 'gymnasium.spaces.dict.Dict'>"),
        "the observation space is Dict of shape [3], and only a Box can be read",
    ),
    (setting("observation_space", ":type:", to="<class 'mine.Box'>"), "is <class 'mine.Box'> of"),
    (setting("observation_space", "_shape", to=[3, 4]), "should have shape (64, 12)"),
    (setting("observation_space", "_shape", to=[3, 0]), "is Box of shape [3, 0]"),
    (setting("observation_space", "_shape", to="(3,)"), "is Box of shape (3,)"),
    (setting("observation_space", "_shape", to=[True]), "is Box of shape [True]"),
    (setting("observation_space", "_shape", to=[0]), "is Box of shape [0]"),
    (setting("observation_space", "_shape", to=[4]), "should have shape (64, 4)"),
    (setting(BOX, to=None), "no readable 'action_space'"),
    (
        setting(BOX, ":type:", to="<class 'gymnasium.spaces.multi_discrete.MultiDiscrete'>"),
        "the action space is MultiDiscrete of shape [1], and only a Box or Dis",
    ),
    (setting(BOX, "dtype", to="float64"), "has dtype float64, and only float32 can be read"),
    (setting(BOX, "low", to="[-1. ... -1.]"), "does not spell out 1 numbers"),
    (setting(BOX, "low", to="[-2. -2.]"), "printed as [-2. -2.], which does not spell out 1"),
    (setting(BOX, "low", to="[nan]"), "does not spell out 1 numbers"),
    (setting(BOX, "low", to="-2."), "does not spell out 1 numbers"),
    (setting(BOX, "low", to="[[-2.]]"), "does not spell out 1 numbers"),
    (setting(BOX, "low", to="[__import__('os')]"), "does not spell out 1 numbers"),
    (setting(BOX, "low", to=-2.0), "printed as -2.0, which does not spell out 1 numbers"),
    (setting(BOX, "low", to="[" + "x" * 999), "x..., which does not spell out"),
    (setting(BOX, "high", to="[0.01234568]"), "'high' is printed as 0.01234568, which may be"),
    (
        setting(BOX, "low", to="[3.]"),
        "finite and 'low' not above 'high', got Box([3.0], [2.0]); give",
    ),
    (setting(BOX, "high", to="[inf]"), "must be finite and 'low' not above 'high', got Box([-2."),
    (discrete("0"), "Discrete(n=0, start=0) cannot be read"),
    (discrete("two"), "Discrete(n=two, start=0) cannot be read"),
    (discrete("2", start="1"), "counts actions from 0; train in an environment with start=0"),
    (discrete("1", squash=True), "the action space Discrete(1) has no bounds"),
    (discrete("2"), "'action_net.weight' should have shape (2, 64)"),
    (setting(KWARGS, "net_arch", to=[64]), "'mlp_extractor.policy_net.2.weight' have no place in"),
    (setting(KWARGS, "net_arch", to=[64, 32]), "should have shape (32, 64) for the saved arch"),
    (setting(KWARGS, "net_arch", to=[64, 64, 64]), "and have none; save it again"),
]


@pytest.mark.parametrize(("edit", "reason"), UNREADABLE_DATA)
def test_data_that_does_not_settle_the_policy_is_refused(
    edit: Callable[[dict[str, Any]], None], reason: str, pendulum_zip: Path, tmp_path: Path
) -> None:
    assert reason in refusal(rewritten(pendulum_zip, tmp_path / "edited.zip", edit))


def test_harmless_data_is_accepted(pendulum_zip: Path, tmp_path: Path) -> None:
    def edit(data: dict[str, Any]) -> None:
        data["policy_kwargs"] = {
            ":type:": "<class 'dict'>",
            "net_arch": [{"pi": [64, 64], "vf": [1]}],
            "activation_fn": TORCH_CLASS.format("Tanh"),
            "features_extractor_class": architecture._FLATTEN,
            "optimizer_class": "<class 'mine.Optimizer'>",
            "log_std_init": -1.0,
        }
        data["observation_space"][":type:"] = "<class 'gym.spaces.box.Box'>"

    policy = read_sb3_zip(rewritten(pendulum_zip, tmp_path / "edited.zip", edit))
    assert policy.content_hash == read_sb3_zip(pendulum_zip).content_hash


def test_other_policies_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "other.zip"
    env = BoxEnv(spaces.Dict(a=UNIT_3), spaces.Discrete(2))
    sb3.PPO("MultiInputPolicy", env, device="cpu").save(path)
    assert "the policy class is MultiInputActorCriticPolicy of" in refusal(path)
    env = BoxEnv(spaces.Discrete(4), spaces.Discrete(2))
    sb3.PPO("MlpPolicy", env, device="cpu").save(path)
    assert "the observation space is Discrete of shape []" in refusal(path)
