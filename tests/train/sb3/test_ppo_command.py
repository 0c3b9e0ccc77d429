"""`integ-gym train` with PPO on the command line."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from small_ppo import FLAGS

from integ_gym.train import command
from integ_gym.train.command import training_command as main
from integ_gym.train.policy_files.sidecar import TrainedPolicy, read_trained
from integ_gym.train.ppo import PPOConfig

torch = pytest.importorskip("torch")
sb3 = pytest.importorskip("stable_baselines3")


def test_main_trains_and_says_where_the_policy_is(
    small: TrainedPolicy, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "new" / "folder"
    assert main([*FLAGS, "--out", str(out)]) == 0
    printed = capsys.readouterr()
    assert printed.out.startswith(f"policy: {out / 'policy.zip'} (512 steps in ")
    assert "last 8 training episodes, exploration included: return -" in printed.out
    assert "success 0.00" in printed.err
    assert read_trained(out / "policy.zip")[0].content_hash == small.content_hash


def test_flags_reach_the_run() -> None:
    given = vars(
        command.training_parser().parse_args(
            [
                *("--out", "x", "--env", "IntegCartPole-v0", "--control-period", "none"),
                *("--max-speed", "8", "--env-arg", "mass=0.2", "--env-arg"),
                *("mass_distribution=point", "--env-arg", "sutton_barto_reward=true"),
                *("--no-normalize-advantage", "--learning-rate-end", "0", "--target-kl", "none"),
            ]
        )
    )
    told = ("out", "force", "tensorboard", "progress", "trainer", "algorithm")
    config = command._config(PPOConfig, {k: v for k, v in given.items() if k not in told})
    assert config.env_arguments == {
        "control_period": None,
        "max_speed": 8.0,
        "mass": 0.2,
        "mass_distribution": "point",
        "sutton_barto_reward": True,
    }
    expected = PPOConfig.of(
        "IntegCartPole-v0",
        env_arguments=config.env_arguments,
        normalize_advantage=False,
        learning_rate_end=0.0,
    )
    assert config == expected


@pytest.mark.parametrize(
    ("flags", "message"),
    [
        (["--env", "MountainCar-v0"], "is no MuJoCo task; give IntegCartPole-v0"),
        (["--integrator", "rk5"], "unknown integrator 'rk5'. Did you mean 'rk4'? Valid choices"),
        (["--engine", "unreal"], "unknown engine 'unreal'. Valid choices: casadi, dart"),
        (["--dt", "0"], "`dt` must be a finite number above 0, got 0.0"),
        (["--control-period", "0.07"], "`control_period`=0.07 s is not a whole multiple of `dt`"),
        (["--start", "sideways"], "unknown start 'sideways'. Valid choices: hanging, uniform"),
        (["--env-arg", "mas=1"], "unexpected keyword argument 'mas'. Did you mean 'mass'?"),
        (["--env-arg", "mass"], "argument --env-arg: expected NAME=VALUE, got 'mass'"),
        (["--env-arg", "mass=heavy"], "`mass` must be a finite number above 0, got 'heavy'"),
        (["--max-torque", "much"], "argument --max-torque: invalid float value: 'much'"),
        (["--max-speed", "much"], "argument --max-speed: invalid number value: 'much'"),
        (["--batch-size", "100"], "`batch_size`=100 does not divide a rollout"),
        (["--net-arch", "64", "0"], "`net_arch` must be a list of at most 16 whole numbers"),
        (["--lr", "1"], "unrecognized arguments: --lr 1"),
        (["--out", __file__], f"{__file__} is a file; give a folder for the policy"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(
    flags: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    try:
        code: Any = main(["--out", str(tmp_path / "out"), *flags])
    except SystemExit as exit_:
        code = exit_.code
    printed = capsys.readouterr()
    assert code == 2
    assert printed.out == ""
    assert printed.err.startswith("integ-gym train: error: ")
    assert message in printed.err
    assert printed.err.count("\n") == 1
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("missing", ["torch", "stable_baselines3", "rich", "tensorboard"])
def test_a_missing_extra_names_the_command(
    missing: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setitem(sys.modules, missing, None)
    assert main([*FLAGS, "--out", str(tmp_path)]) == 2
    assert capsys.readouterr().err == (
        f'integ-gym train: error: {missing} is not installed; run: pip install -e ".[train]"\n'
    )


def test_importing_the_trainer_imports_no_learner() -> None:
    code = (
        "import sys, integ_gym.train.ppo\n"
        "assert not {'torch', 'stable_baselines3', 'tensorboard', 'jax'} & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
