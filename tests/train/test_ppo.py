"""The PPO trainer: what it writes, that it repeats itself, and that it learns."""

from __future__ import annotations

import json
import math
import os
import random
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import VectorWrapper

import integ_gym  # noqa: F401  (registers the environments)
from integ_gym.train import ppo, sidecar
from integ_gym.train.baselines import make_baseline
from integ_gym.train.ppo import ENVIRONMENT_DEFAULTS, PPOConfig, first_lane_seed, main, train
from integ_gym.train.sb3_zip import PolicyFileError
from integ_gym.train.sidecar import TrainedPolicy, read_sidecar, read_trained

torch = pytest.importorskip("torch")
sb3 = pytest.importorskip("stable_baselines3")

SMALL = PPOConfig(
    env_arguments={"integrator": "rk4", "max_torque": 0.8, "duration": 2.5, "start": "hanging"},
    seed=3,
    total_steps=500,
    n_envs=4,
    n_steps=64,
    batch_size=64,
    n_epochs=2,
    net_arch=(16, 8),
)
FLAGS = [
    *("--integrator", "rk4", "--max-torque", "0.8", "--duration", "2.5", "--start", "hanging"),
    *("--seed", "3", "--total-steps", "500", "--n-envs", "4", "--n-steps", "64"),
    *("--batch-size", "64", "--n-epochs", "2", "--net-arch", "16", "8"),
]


class Recorder(VectorWrapper[Any, Any, Any, Any, Any]):
    """Adds up what a recorder would see."""

    def __init__(self, env: Any, fail_at: int | None = None) -> None:
        super().__init__(env)
        self.fail_at = fail_at
        self.rewards: list[np.ndarray] = []
        self.starts: list[np.ndarray] = []
        self.closed_by_trainer = False

    def reset(self, **kwargs: Any) -> Any:
        result = super().reset(**kwargs)
        self.starts.append(self.env.unwrapped.state)  # type: ignore[attr-defined]
        return result

    def step(self, actions: Any) -> Any:
        if len(self.rewards) == self.fail_at:
            raise KeyboardInterrupt
        result = super().step(actions)
        self.rewards.append(result[1])
        return result

    def close(self, **kwargs: Any) -> None:
        self.closed_by_trainer = True
        super().close(**kwargs)


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> TrainedPolicy:
    return train(SMALL, tmp_path_factory.mktemp("small"), progress=False)


def files_of(folder: Path) -> set[str]:
    return {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}


# --- configuration ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"env_id": "IntegPendulm-v0"}, "unknown environment 'IntegPendulm-v0'. Did you mean"),
        ({"seed": -1}, "`seed` must be a whole number, from 0 to 4294967295, got -1"),
        ({"n_envs": 2.0}, "`n_envs` must be a whole number, 1 or above, got 2.0"),
        ({"batch_size": 96}, "`batch_size`=96 does not divide a rollout of `n_envs` × `n_steps`"),
        ({"learning_rate": 0.0}, "`learning_rate` must be a finite number above 0, got 0.0"),
        ({"gae_lambda": 1.5}, "`gae_lambda` must be a number from 0 to 1, got 1.5"),
        ({"discount_time": math.inf}, "`discount_time` must be a finite number above 0, got inf"),
        ({"net_arch": (64, 0)}, "`net_arch` must be a list of whole numbers, 1 or above"),
        ({"activation": "Sine"}, "`activation` must be one of 'Tanh'"),
        ({"env_arguments": [1]}, "`env_arguments` must map argument names to values"),
        ({"target_kl": -1}, "`target_kl` must be a finite number above 0, or None"),
        ({"reward_scale": True}, "`reward_scale` must be a finite number above 0, got True"),
    ],
)
def test_impossible_values_are_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError) as caught:
        replace(SMALL, **changes)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_config_survives_json() -> None:
    assert PPOConfig(**json.loads(json.dumps(asdict(SMALL)))) == SMALL


@pytest.mark.parametrize("env_id", ENVIRONMENT_DEFAULTS)
def test_defaults_of_each_environment(env_id: str) -> None:
    config = PPOConfig.of(env_id, seed=5)
    assert (config.env_id, config.seed) == (env_id, 5)
    for name, value in ENVIRONMENT_DEFAULTS[env_id].items():
        assert getattr(config, name) == value


def test_discount_is_a_time_constant() -> None:
    config = PPOConfig(discount_time=2.0)
    assert config.discount(0.05) == pytest.approx(math.exp(-0.025), rel=1e-15)
    assert config.discount(0.1) == pytest.approx(config.discount(0.05) ** 2, rel=1e-15)


def test_runs_are_whole_rollouts() -> None:
    assert SMALL.rollout == 256
    assert SMALL.rounded_steps == 512


def test_lanes_of_neighbouring_seeds_do_not_overlap() -> None:
    seeds = sorted(first_lane_seed(seed) for seed in range(1000))
    assert np.diff(seeds).min() > 1000


# --- what a run writes ------------------------------------------------------------------------


WRITTEN = {"policy.zip", "policy.json", "policy.safetensors"}


def test_files(small: TrainedPolicy) -> None:
    folder = small.policy.parent
    names = files_of(folder)
    assert names >= WRITTEN
    (log,) = names - WRITTEN
    assert log.startswith("tensorboard/events.out.tfevents")
    assert {path.name for path in folder.iterdir()} == WRITTEN | {"tensorboard"}


def test_policy_acts_as_sb3_loads_it(small: TrainedPolicy) -> None:
    policy, card = read_trained(small.policy)
    assert policy.content_hash == small.content_hash == card["content_hash"]
    assert policy.policy_id == "ppo-rk4-dt0.05-seed3"
    model = sb3.PPO.load(small.policy, device="cpu")
    observations = np.random.default_rng(0).normal(size=(50, 3)).astype(np.float32)
    theirs, _ = model.predict(observations, deterministic=True)
    np.testing.assert_allclose(policy.act(observations), theirs, rtol=0, atol=1e-6)
    env = gym.make("IntegPendulum-v0", **SMALL.env_arguments)
    policy.check_spaces(env.observation_space, env.action_space)


def test_sidecar_says_how_the_policy_came_about(small: TrainedPolicy) -> None:
    card = read_sidecar(small.policy)
    assert card == json.loads(json.dumps(dict(small.card)))
    assert PPOConfig(**card["config"]) == SMALL
    assert card["env_id"] == "IntegPendulum-v0"
    assert card["discretization"] == {
        "engine": "native",
        "engine_version": card["versions"]["integ-gym"],
        "integrator": "rk4",
        "dt": 0.05,
        "control_period": 0.05,
    }
    assert card["mixture"] is None
    setup = gym.make("IntegPendulum-v0", **SMALL.env_arguments).unwrapped.setup  # type: ignore[attr-defined]
    assert card["env_arguments"] == setup.arguments()
    assert card["units"]["max_torque"] == "N m"
    assert card["action_bounds"] == [[float(np.float32(-0.8))], [float(np.float32(0.8))]]
    assert card["derived"]["gamma"] == pytest.approx(math.exp(-0.05), rel=1e-15)
    assert card["derived"]["gae_lambda"] == SMALL.gae_lambda
    assert (card["seed"], card["steps"]) == (3, 512)
    assert card["wall_seconds"] > 0
    assert card["last_episodes"]["episodes"] == 8  # 4 environments, 128 steps, 50 per episode
    assert card["last_episodes"]["success_rate"] == 0.0
    assert -2000 < card["last_episodes"]["return_mean"] < 0
    assert set(card["versions"]) >= {"integ-gym", "gymnasium", "numpy", "torch"}
    assert str(Path.home()) not in small.sidecar.read_text()
    assert str(small.policy.parent) not in small.sidecar.read_text()


def test_rewards_are_scaled_for_the_learner_only(tmp_path: Path) -> None:
    seen: list[Recorder] = []

    def wrap(env: Any) -> Any:
        seen.append(Recorder(env))
        return seen[-1]

    config = replace(SMALL, reward_scale=1e-6)
    trained = train(config, tmp_path, wrap=wrap, progress=False, tensorboard=False)
    (recorder,) = seen
    rewards = np.array(recorder.rewards)
    assert rewards.shape == (128, 4)
    assert rewards.min() < -9.0  # near -π² while hanging
    episodes = rewards[:100].reshape(2, 50, 4).sum(axis=1)
    assert trained.card["last_episodes"]["return_mean"] == pytest.approx(episodes.mean(), rel=1e-5)
    assert recorder.closed_by_trainer
    assert files_of(tmp_path) == WRITTEN
    lanes = first_lane_seed(config.seed)
    env = gym.make("IntegPendulum-v0", **config.env_arguments)
    env.reset(seed=lanes + 2)
    np.testing.assert_array_equal(recorder.starts[0][2], env.unwrapped.state)  # type: ignore[attr-defined]


def test_steps_are_told_as_they_are_taken(small: TrainedPolicy, tmp_path: Path) -> None:
    told: list[int] = []
    trained = train(SMALL, tmp_path, progress=False, on_steps=told.append, tensorboard=False)
    assert told == [4] * 128
    assert trained.content_hash == small.content_hash


def test_a_mixture_is_told_apart(tmp_path: Path) -> None:
    mixture = [{"integrator": "rk4"}, {"integrator": "explicit_euler", "dt": 0.025}]
    arguments = {"control_period": 0.05, "duration": 0.5, "mixture": mixture}
    config = replace(SMALL, env_arguments=arguments, total_steps=256)
    trained = train(config, tmp_path, progress=False, tensorboard=False)
    assert trained.card["discretization"] is None
    assert [member["integrator"] for member in trained.card["mixture"]] == ["rk4", "explicit_euler"]
    assert [member["dt"] for member in trained.card["mixture"]] == [0.05, 0.025]
    assert trained.card["policy_id"] == "ppo-mixture-seed3"


def test_discrete_actions_and_options_of_the_learner(tmp_path: Path) -> None:
    config = replace(
        SMALL,
        env_id="IntegCartPole-v0",
        env_arguments={},
        total_steps=256,
        learning_rate_end=0.0,
        activation="ReLU",
        target_kl=0.01,
    )
    trained = train(config, tmp_path, progress=False, tensorboard=False)
    policy, card = read_trained(trained.policy)
    assert card["action_bounds"] is None
    assert policy.activation == "ReLU"
    assert policy.act(np.zeros((3, 4))).dtype == np.int64


# --- the same again ---------------------------------------------------------------------------


def test_another_process_gives_the_same_weights(small: TrainedPolicy, tmp_path: Path) -> None:
    command = [sys.executable, ppo.__file__, *FLAGS, "--out", str(tmp_path), "--no-tensorboard"]
    environment = os.environ | {"PYTHONHASHSEED": "77"}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    card = read_sidecar(tmp_path / "policy.zip")
    assert card["content_hash"] == small.content_hash
    assert card["config"] == json.loads(json.dumps(asdict(SMALL)))
    assert str(tmp_path / "policy.zip") in done.stdout
    assert "success 0.00" in done.stdout
    assert "512" in done.stderr  # the bar


def test_seed_and_every_hyperparameter_that_matters_change_the_weights(
    small: TrainedPolicy, tmp_path: Path
) -> None:
    changes: list[dict[str, Any]] = [
        {"seed": 4},
        {"reward_scale": 0.2},
        {"discount_time": 0.5},
        {"gae_lambda": 0.5},
        {"learning_rate_end": 1e-5},
    ]
    hashes = {small.content_hash}
    for index, change in enumerate(changes):
        config = replace(SMALL, **change)
        folder = tmp_path / str(index)
        hashes.add(train(config, folder, progress=False, tensorboard=False).content_hash)
    assert len(hashes) == 1 + len(changes)


@pytest.fixture
def two_threads() -> Iterator[None]:
    before = torch.get_num_threads()
    torch.set_num_threads(2)
    yield
    torch.set_num_threads(before)


@pytest.mark.usefixtures("two_threads")
def test_nothing_outside_the_run_changes(small: TrainedPolicy, tmp_path: Path) -> None:
    jax = pytest.importorskip("jax")

    def outside() -> list[Any]:
        return [
            torch.get_num_threads(),
            torch.get_rng_state().tolist(),
            torch.are_deterministic_algorithms_enabled(),
            random.getstate(),
            [x.tolist() if isinstance(x, np.ndarray) else x for x in np.random.get_state()],  # noqa: NPY002
            dict(os.environ),
            dict(jax.config.values),
            np.geterr(),
            os.getcwd(),
        ]

    torch.manual_seed(1)
    before = outside()
    trained = train(SMALL, tmp_path, progress=False, tensorboard=False)
    assert outside() == before
    assert trained.content_hash == small.content_hash


# --- a policy is there whole, or not at all ---------------------------------------------------


def test_an_interrupted_run_leaves_no_policy(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    made: list[Recorder] = []
    make = ppo.make_training_envs

    def interrupted(config: PPOConfig) -> Any:
        made.append(Recorder(make(config), fail_at=70))
        return made[-1]

    monkeypatch.setattr(ppo, "make_training_envs", interrupted)
    assert main([*FLAGS, "--out", str(tmp_path), "--no-tensorboard", "--no-progress"]) == 130
    assert "interrupted; no policy was written" in capsys.readouterr().err
    assert files_of(tmp_path) == set()
    assert made[-1].closed_by_trainer


@pytest.mark.parametrize("replaced_before_the_end", [0, 1])
def test_a_run_killed_while_writing_leaves_no_sidecar(
    replaced_before_the_end: int,
    small: TrainedPolicy,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for path in (small.policy, small.sidecar):
        (tmp_path / path.name).write_bytes(path.read_bytes())
    renamed: list[Any] = []
    replace_file = os.replace

    def killed(source: Any, target: Any) -> None:
        if len(renamed) == replaced_before_the_end:
            raise KeyboardInterrupt
        renamed.append(target)
        replace_file(source, target)

    monkeypatch.setattr(sidecar.os, "replace", killed)
    with pytest.raises(KeyboardInterrupt):
        train(replace(SMALL, seed=9), tmp_path, progress=False, tensorboard=False, force=True)
    assert files_of(tmp_path) == {"policy.zip"}
    with pytest.raises(PolicyFileError, match="keep the side-car beside the policy"):
        read_trained(tmp_path / "policy.zip")


def test_a_policy_is_replaced_only_by_force(small: TrainedPolicy, tmp_path: Path) -> None:
    (tmp_path / "policy.zip").write_bytes(b"something else")
    with pytest.raises(FileExistsError, match=r"already holds policy\.zip; .* or --force"):
        train(SMALL, tmp_path, progress=False)
    trained = train(SMALL, tmp_path, progress=False, tensorboard=False, force=True)
    assert trained.content_hash == small.content_hash
    assert files_of(tmp_path) == WRITTEN


def test_a_sidecar_of_another_policy_is_found_out(small: TrainedPolicy, tmp_path: Path) -> None:
    (tmp_path / "policy.zip").write_bytes(small.policy.read_bytes())
    path = tmp_path / "policy.json"
    for text, message in (
        (
            json.dumps({**small.card, "content_hash": "0" * 64}),
            r"is not the policy that policy\.js",
        ),
        (json.dumps({**small.card, "format": "other"}), "has format 'other' where 'integ-gym poli"),
        ("[]", "has format None where"),
        ("{", "is not readable JSON"),
    ):
        path.write_text(text)
        with pytest.raises(PolicyFileError, match=message):
            read_trained(tmp_path / "policy.zip")


# --- command line -----------------------------------------------------------------------------


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
        ppo.parser().parse_args(
            [
                *("--out", "x", "--env", "IntegCartPole-v0", "--control-period", "none"),
                *("--max-speed", "8", "--env-arg", "mass=0.2", "--env-arg"),
                *("mass_distribution=point", "--env-arg", "sutton_barto_reward=true"),
                *("--no-normalize-advantage", "--learning-rate-end", "0", "--target-kl", "none"),
            ]
        )
    )
    config = ppo._config({k: v for k, v in given.items() if k not in (
        "out", "force", "tensorboard", "progress", "trainer"
    )})  # fmt: skip
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
        (["--env", "CartPole-v1"], "unknown environment 'CartPole-v1'. Did you mean"),
        (["--integrator", "rk5"], "unknown integrator 'rk5'. Did you mean 'rk4'? Valid choices"),
        (["--engine", "unreal"], "unknown engine 'unreal'. Valid choices: casadi, dart"),
        (["--dt", "0"], "`dt` must be a finite number above 0, got 0.0"),
        (["--control-period", "0.07"], "`control_period`=0.07 s is not a whole multiple of `dt`"),
        (["--start", "sideways"], "unknown start 'sideways'. Valid choices: hanging, uniform"),
        (["--env-arg", "mas=1"], "unknown argument 'mas'. Did you mean 'mass'?"),
        (["--env-arg", "mass"], "argument --env-arg: expected NAME=VALUE, got 'mass'"),
        (["--env-arg", "mass=heavy"], "`mass` must be a finite number above 0, got 'heavy'"),
        (["--max-torque", "much"], "argument --max-torque: invalid float value: 'much'"),
        (["--max-speed", "much"], "argument --max-speed: invalid number value: 'much'"),
        (["--batch-size", "100"], "`batch_size`=100 does not divide a rollout"),
        (["--net-arch", "64", "0"], "`net_arch` must be a list of whole numbers"),
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


def test_a_policy_in_the_way_is_one_line_and_exit_code_2(
    small: TrainedPolicy, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*FLAGS, "--out", str(small.policy.parent)]) == 2
    assert "already holds policy.zip and policy.json; give another" in capsys.readouterr().err


@pytest.mark.parametrize("missing", ["torch", "stable_baselines3", "tqdm", "tensorboard"])
def test_a_missing_extra_names_the_command(
    missing: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setitem(sys.modules, missing, None)
    assert main([*FLAGS, "--out", str(tmp_path)]) == 2
    assert capsys.readouterr().err == (
        f'integ-gym train: error: {missing} is not installed; run: pip install "integ-gym[train]"\n'
    )


def test_help_has_examples_and_every_hyperparameter(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        main(["--help"])
    assert caught.value.code == 0
    text = capsys.readouterr().out
    assert "examples:\n  integ-gym train " in text
    for name in asdict(SMALL):
        if name not in ("env_id", "env_arguments"):
            assert f"--{name.replace('_', '-')}" in text


def test_importing_the_trainer_imports_no_learner() -> None:
    code = (
        "import sys, integ_gym.train.ppo\n"
        "assert not {'torch', 'stable_baselines3', 'tensorboard', 'jax'} & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


# --- it learns --------------------------------------------------------------------------------


def result_of(policy: Any, env_id: str, **arguments: Any) -> tuple[float, float]:
    """Success rate and mean return of 50 episodes under the policy's deterministic actions."""
    envs = gym.make_vec(env_id, 50, vectorization_mode="vector_entry_point", **arguments)
    observations, _ = envs.reset(seed=10_000)
    ended, success, returns = np.zeros(50, dtype=bool), np.zeros(50, dtype=bool), np.zeros(50)
    while not ended.all():
        observations, rewards, terminated, truncated, info = envs.step(policy.act(observations))
        returns += np.where(ended, 0.0, rewards)
        first = (terminated | truncated) & ~ended
        success[first] = info["success"][first]
        ended |= first
    return float(success.mean()), float(returns.mean())


@pytest.mark.slow
def test_learns_to_balance(tmp_path: Path) -> None:
    config = PPOConfig.of("IntegCartPole-v0", total_steps=35_000)
    trained = train(config, tmp_path, progress=False, tensorboard=False)
    policy, _ = read_trained(trained.policy)
    success, returned = result_of(policy, "IntegCartPole-v0", integrator="reference", dt=0.02)
    assert success >= 0.9
    assert returned >= 450.0  # random: 21


@pytest.mark.slow
def test_learns_to_swing_up(tmp_path: Path) -> None:
    """With torque to spare a short run is far better than chance; success takes a longer one."""
    arguments = {"integrator": "rk4", "dt": 0.05, "max_torque": 6.0, "start": "hanging"}
    config = PPOConfig.of(
        "IntegPendulum-v0",
        env_arguments=arguments,
        total_steps=50_000,
        n_steps=128,
        gae_lambda=0.9,
    )
    trained = train(config, tmp_path, progress=False, tensorboard=False)
    policy, _ = read_trained(trained.policy)
    _, returned = result_of(policy, "IntegPendulum-v0", **arguments)
    random_policy = make_baseline("random", setup_of(arguments))
    _, chance = result_of(random_policy, "IntegPendulum-v0", **arguments)
    assert returned > chance + 300.0  # about 750 here


def setup_of(arguments: dict[str, Any]) -> Any:
    return gym.make("IntegPendulum-v0", **arguments).unwrapped.setup  # type: ignore[attr-defined]
