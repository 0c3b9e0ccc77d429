"""Files of VecNormalize's statistics."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from policy_files import refusal

from integ_gym.train.policy_files import card as limits
from integ_gym.train.policy_files.card import PolicyFileError
from integ_gym.train.policy_files.sb3_zip import read_observation_statistics, read_sb3_zip

GOOD_STATISTICS = {"mean": [0.0, 1, -2.5], "var": [1.0, 0, 4.0], "epsilon": 1e-8, "clip_obs": 10}


def test_statistics_file_is_read(tmp_path: Path) -> None:
    path = tmp_path / "statistics.json"
    path.write_text(json.dumps(GOOD_STATISTICS))
    statistics = read_observation_statistics(path)
    np.testing.assert_array_equal(statistics.mean, [0.0, 1.0, -2.5])
    np.testing.assert_array_equal(statistics.var, [1.0, 0.0, 4.0])
    assert (statistics.epsilon, statistics.clip_obs) == (1e-8, 10.0)
    normal = statistics.normalize(np.array([[0.5, 1.0, 97.5]], dtype=np.float32))
    np.testing.assert_allclose(normal, [[0.5, 0.0, 10.0]], rtol=1e-6)
    assert normal.dtype == np.float32


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        ("{", "the file is not readable JSON"),
        ("3", "the file is not a JSON object"),
        ("{}", "expected the keys mean, var and perhaps epsilon, clip_obs, got "),
        ({"count": 1}, "got clip_obs, count, epsilon, mean, var"),
        ({"mean": 0.0}, "'mean' must be a list of finite numbers"),
        ({"mean": [0.0, "1", 2]}, "'mean' must be a list of finite numbers"),
        ({"mean": [True, False, True]}, "'mean' must be a list of finite numbers"),
        ({"mean": [0.0, 1.0, float("nan")]}, "'mean' must be a list of finite numbers"),
        ({"mean": [0, 1, 10**400]}, "'mean' must be a list of finite numbers"),
        ({"var": [1.0, 2.0, float("inf")]}, "'var' must be a list of finite numbers"),
        ({"var": [1.0, 2.0]}, "of one length, got shapes (3,) and (2,)"),
        ({"var": [1.0, -2.0, 1.0]}, "'var' must hold no negative number, got -2.0"),
        ({"epsilon": "small"}, "'epsilon' must be a finite number, got 'small'"),
        ({"epsilon": 0}, "'epsilon' must be a finite number above 0, got 0"),
        ({"clip_obs": None}, "'clip_obs' must be a finite number, got None"),
        ({"clip_obs": -1.0}, "'clip_obs' must be a finite number above 0, got -1.0"),
    ],
)
def test_wrong_statistics_are_refused(
    content: str | dict[str, Any], reason: str, tmp_path: Path, pendulum_zip: Path
) -> None:
    path = tmp_path / "statistics.json"
    text = content if isinstance(content, str) else json.dumps(GOOD_STATISTICS | content)
    path.write_text(text)
    for read in (read_observation_statistics, lambda p: read_sb3_zip(pendulum_zip, p)):
        with pytest.raises(PolicyFileError) as caught:
            read(path)
        message = str(caught.value)
        assert message.startswith(f"{path}: ")
        assert reason in message
        assert "write {" in message
        assert "\n" not in message


def test_statistics_that_cannot_be_opened_or_are_too_large_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "statistics.json"
    with pytest.raises(PolicyFileError, match=r"cannot be opened \(No such file"):
        read_observation_statistics(path)
    path.write_text(json.dumps(GOOD_STATISTICS))
    monkeypatch.setattr(limits, "MAX_JSON_BYTES", 10)
    with pytest.raises(PolicyFileError, match=r"has more than 10 bytes, which .*; give the file"):
        read_observation_statistics(path)


def test_statistics_of_another_length_are_refused(pendulum_zip: Path, tmp_path: Path) -> None:
    path = tmp_path / "statistics.json"
    path.write_text(json.dumps(GOOD_STATISTICS | {"mean": [0.0], "var": [1.0]}))
    message = refusal(pendulum_zip, path)
    assert "statistics have shape (1,) and the policy takes observations of shape (3,)" in message
