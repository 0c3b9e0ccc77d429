"""`integ-gym train`, and what no training is configured with."""

from __future__ import annotations

import math
import subprocess
import sys
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from small_ppo import SMALL

from integ_gym.train import command
from integ_gym.train.command import training_command as main
from integ_gym.train.policy_files.sidecar import read_trained
from integ_gym.train.ppo import PPOConfig
from integ_gym.train.sac import SACConfig


def test_the_command_takes_an_algorithm(tmp_path, capsys):
    flags = ["--no-progress", "--no-tensorboard", "--duration", "1", "--out", str(tmp_path / "a")]
    sac = ["--algorithm", "sac", "--total-steps", "40", "--learning-starts", "20"]
    assert main([*sac, *flags]) == 0
    _, card = read_trained(tmp_path / "a" / "policy.zip")
    assert card["algorithm"] == "SAC"
    out = tmp_path / "a"
    judged = f"integ-gym evaluate {out}/policy.zip --env IntegPendulum-v0 --out {out}-judged"
    assert judged in capsys.readouterr().out
    assert main([*sac, *flags, "--force", "--trainer", "fleet"]) == 2
    assert "the fleet trains PPO; train SAC with --trainer sb3" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main(["--algorithm", "sac", "--help"])
    shown = capsys.readouterr().out
    assert "--learning-starts" in shown
    assert "--n-epochs" not in shown


def test_flags_reach_the_run():
    flags = """--out x --env IntegCartPole-v0 --control-period none --max-speed 8
        --env-arg mass=0.2 --env-arg mass_distribution=point --env-arg sutton_barto_reward=true
        --no-normalize-advantage --learning-rate-end 0 --target-kl none"""
    given = vars(command.training_parser().parse_args(flags.split()))
    told = ("out", "force", "tensorboard", "progress", "trainer", "algorithm")
    config = command._config(PPOConfig, {k: v for k, v in given.items() if k not in told})
    arguments = {"control_period": None, "max_speed": 8.0, "mass": 0.2}
    arguments |= {"mass_distribution": "point", "sutton_barto_reward": True}
    options = {"normalize_advantage": False, "learning_rate_end": 0.0}
    assert config == PPOConfig.of("IntegCartPole-v0", env_arguments=arguments, **options)


@pytest.mark.parametrize(
    ("flags", "message"),
    [
        (["--env", "MountainCar-v0"], "is no MuJoCo task; give IntegAcrobot-v0"),
        (["--integrator", "rk5"], "unknown integrator 'rk5'. Did you mean 'rk4'? Valid choices"),
        (["--engine", "unreal"], "unknown engine 'unreal'. Valid choices: casadi, dart"),
        (["--control-period", "0.07"], "`control_period`=0.07 s is not a whole multiple of `dt`"),
        (["--env-arg", "mas=1"], "unexpected keyword argument 'mas'. Did you mean 'mass'?"),
        (["--env-arg", "mass"], "argument --env-arg: expected NAME=VALUE, got 'mass'"),
        (["--env-arg", "mass=heavy"], "`mass` must be a finite number above 0, got 'heavy'"),
        (["--max-speed", "much"], "argument --max-speed: invalid number value: 'much'"),
        (["--batch-size", "100"], "`batch_size`=100 does not divide a rollout"),
        (["--lr", "1"], "unrecognized arguments: --lr 1"),
        (["--out", __file__], f"{__file__} is a file; give a folder for the policy"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(flags, message, tmp_path, capsys):
    try:
        code: Any = main(["--out", str(tmp_path / "out"), *flags])
    except SystemExit as exit_:
        code = exit_.code
    printed = capsys.readouterr()
    assert (code, printed.out) == (2, "")
    assert printed.err.startswith("integ-gym train: error: ")
    assert message in printed.err
    assert printed.err.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_importing_the_trainer_imports_no_learner():
    code = (
        "import sys, integ_gym.train.ppo\n"
        "assert not {'torch', 'stable_baselines3', 'tensorboard', 'jax'} & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.parametrize(
    ("config", "changes", "message"),
    [
        (SMALL, {"env_id": "IntegPendulm-v0"}, "unknown environment 'IntegPendulm-v0'. Did you"),
        (SMALL, {"seed": -1}, "`seed` must be a whole number, from 0 to 4294967295, got -1"),
        (SMALL, {"n_envs": 2.0}, "`n_envs` must be a whole number, from 1 to 65536, got 2.0"),
        (SMALL, {"n_steps": 10**12}, "is kept in memory, and at most 16777216 are; give fewer"),
        (SMALL, {"gae_lambda": 1.5}, "`gae_lambda` must be a number from 0 to 1, got 1.5"),
        (SMALL, {"net_arch": (64, 0)}, "`net_arch` must be a list of at most 16 whole numbers"),
        (SMALL, {"activation": "Sine"}, "`activation` must be one of 'Tanh'"),
        (SMALL, {"env_arguments": [1]}, "`env_arguments` must map argument names to values"),
        (SMALL, {"target_kl": -1}, "`target_kl` must be a finite number above 0, or None"),
        (SMALL, {"reward_scale": True}, "`reward_scale` must be a finite number above 0, got Tr"),
        (SACConfig(), {"tau": 1.5}, "`tau` must be a number from 0 to 1, got 1.5"),
        (SACConfig(), {"gradient_steps": -2}, "`gradient_steps` must be a whole number, -1 or ab"),
    ],
)
def test_impossible_values_are_refused(config, changes, message):
    with pytest.raises(ValueError) as caught:
        replace(config, **changes)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_discount_is_a_time_constant_and_lanes_of_neighbouring_seeds_do_not_overlap():
    config = PPOConfig(discount_time=2.0)
    assert config.discount(0.05) == pytest.approx(math.exp(-0.025), rel=1e-15)
    assert config.discount(0.1) == pytest.approx(config.discount(0.05) ** 2, rel=1e-15)
    seeds = sorted(PPOConfig(seed=seed).first_lane_seed for seed in range(1000))
    assert np.diff(seeds).min() > 1000
