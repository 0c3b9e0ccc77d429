"""Policy files made, changed and refused."""

from __future__ import annotations

import io
import json
import re
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium as gym
import pytest
from gymnasium import spaces

from integ_gym.train.policy import MlpPolicy
from integ_gym.train.policy_files.card import PolicyFileError
from integ_gym.train.policy_files.sb3_zip import read_sb3_zip

torch = pytest.importorskip("torch")

UNIT_3 = spaces.Box(-1.0, 1.0, (3,))


def rewritten(
    source: Path,
    target: Path,
    edit: Callable[[dict[str, Any]], None] | None = None,
    **members: bytes | None,
) -> Path:
    """A copy of a zip with `data` edited in place, other members replaced, or (None) left out."""
    members = {name.replace("__", "."): content for name, content in members.items()}
    with zipfile.ZipFile(source) as old, zipfile.ZipFile(target, "w") as new:
        for name in old.namelist():
            content = members[name] if name in members else old.read(name)
            if name == "data" and edit is not None:
                fields = json.loads(old.read(name))
                edit(fields)
                content = json.dumps(fields).encode()
            if content is not None:
                new.writestr(name, content)
    return target


def state_dict(path: Path) -> dict[str, Any]:
    with zipfile.ZipFile(path) as archive:
        return dict(torch.load(io.BytesIO(archive.read("policy.pth")), weights_only=True))


def saved(tensors: object) -> bytes:
    stream = io.BytesIO()
    torch.save(tensors, stream)
    return stream.getvalue()


def refusal(path: Path, *args: Any, **kwargs: Any) -> str:
    """The message with which a file is refused: the path, then one line, one sentence, a remedy."""
    with pytest.raises(PolicyFileError) as caught:
        read_sb3_zip(path, *args, **kwargs)
    message = str(caught.value)
    start = f"{path}: "
    assert message.startswith(start)
    sentence = message[len(start) :]
    assert "\n" not in sentence
    assert not re.search(r"\. [A-Z]", sentence)
    assert "; " in sentence
    return sentence


def read_or_none(path: Path) -> MlpPolicy | None:
    """The policy, or None where it is refused; any other exception is a failure."""
    try:
        return read_sb3_zip(path)
    except PolicyFileError:
        return None


def setting(*keys: str, to: object) -> Callable[[dict[str, Any]], None]:
    """An edit of `data` that sets one (nested) value."""

    def edit(data: dict[str, Any]) -> None:
        for key in keys[:-1]:
            data = data[key]
        data[keys[-1]] = to

    return edit


class BoxEnv(gym.Env[Any, Any]):
    """Just enough of an environment to build a model for given spaces."""

    def __init__(self, observation_space: spaces.Space[Any], action_space: spaces.Space[Any]):
        self.observation_space, self.action_space = observation_space, action_space

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[Any, dict[str, Any]]:
        return self.observation_space.sample(), {}
