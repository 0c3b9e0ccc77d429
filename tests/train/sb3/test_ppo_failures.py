"""Training that fails on the way is told in one sentence, and leaves no policy."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from small_ppo import FLAGS, SMALL, Recorder, files_of, looked_on, trained

from integ_gym.envs.integrators.rk4 import RK4
from integ_gym.train import ppo
from integ_gym.train.command import training_command as main
from integ_gym.train.ppo import model_to_bytes

torch = pytest.importorskip("torch")
pytest.importorskip("stable_baselines3")


class Raising(RK4):
    """A user's integrator that fails on the way."""

    steps = 0
    kind: type[Exception] = KeyError

    def step(self, *arguments: Any) -> Any:
        Raising.steps += 1
        if Raising.steps > 5:
            raise self.kind("no such\nthing")
        return super().step(*arguments)


@pytest.mark.parametrize(("kind", "said"), [(KeyError, "'no such"), (ValueError, "no such")])
def test_an_integrator_that_fails_is_one_line_and_exit_code_2(
    kind: type[Exception],
    said: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(Raising, "steps", 0)
    monkeypatch.setattr(Raising, "kind", kind)
    own = ["--integrator", f"{__name__}:Raising"]
    assert main([*FLAGS, *own, "--out", str(tmp_path), "--no-tensorboard", "--no-progress"]) == 2
    error = capsys.readouterr().err
    assert f"the integrator '{__name__}:Raising' failed: {kind.__name__}: {said}" in error
    assert error.count("\n") == 1
    assert files_of(tmp_path) == set()


@pytest.mark.parametrize("own", [False, True])
def test_a_wrapper_that_fails_is_not_blamed_on_an_integrator(
    own: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Failing(Recorder):
        def step(self, actions: Any) -> Any:
            raise KeyError("a mistake of its own")

    looked_on(monkeypatch, Failing)
    chosen = {**SMALL.env_arguments, "integrator": f"{__name__}:Raising" if own else "rk4"}
    with pytest.raises(KeyError, match="a mistake of its own"):
        trained(replace(SMALL, env_arguments=chosen), tmp_path)


@pytest.mark.parametrize("last", [False, True])
def test_weights_that_overflow_are_told_with_the_remedy(
    last: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """On the way, or in the last update, which nothing is computed from before it is written."""
    if last:
        monkeypatch.setattr(ppo, "model_to_bytes", _with_overflow)
    flags = [*FLAGS, "--learning-rate", "1e-3" if last else "1e6"]
    assert main([*flags, "--out", str(tmp_path), "--no-tensorboard", "--no-progress"]) == 2
    error = capsys.readouterr().err
    assert "finite" in error
    assert "lower" in error
    assert ".unfinished" not in error
    assert error.count("\n") == 1
    assert files_of(tmp_path) == set()


def _with_overflow(model: Any) -> bytes:
    with torch.no_grad():
        next(model.policy.mlp_extractor.parameters()).fill_(math.inf)
    return model_to_bytes(model)
