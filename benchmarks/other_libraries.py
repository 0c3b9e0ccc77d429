"""A step and a short training of our environments in other libraries of reinforcement learning.

    python benchmarks/other_libraries.py [--only NAME …] [--cleanrl CHECKOUT]

Each library runs in a process of its own, so that one that fails does not hinder the others, and
prints its version with PASS or FAIL. One that is not installed is left out, by name; of CleanRL,
which is on no registry, the path of a checkout is given. Exit code 1 if one failed.
"""

from __future__ import annotations

import argparse
import os
import runpy
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

PENDULUM, CART_POLE = "IntegPendulum-v0", "IntegCartPole-v0"
LIMIT = 900
"""Of one library, s."""

SHARED = ("integ-gym", "gymnasium", "numpy", "torch", "jax")


def stable_baselines3() -> None:
    """PPO over our adapter of the vector environment, and SAC over the single one."""
    import gymnasium as gym
    from stable_baselines3 import PPO, SAC

    from integ_gym.train.vec_env import Sb3VecEnv

    envs = Sb3VecEnv(gym.make_vec(CART_POLE, 4, autoreset_mode="SameStep"))
    PPO("MlpPolicy", envs, n_steps=64, batch_size=64, n_epochs=1).learn(512)
    SAC("MlpPolicy", gym.make(PENDULUM, dt=0.025), learning_starts=50).learn(100)


def sb3_contrib() -> None:
    """TQC, with the time in observations."""
    import gymnasium as gym
    from sb3_contrib import TQC
    from sb3_contrib.common.wrappers import TimeFeatureWrapper

    env = TimeFeatureWrapper(gym.make(PENDULUM))
    env.reset(seed=0)
    ended = False
    while not ended:
        observation, _, _, ended, _ = env.step(env.action_space.sample())
    assert observation[-1] == 0.0, f"the clock shows {observation[-1]} at the end"
    TQC("MlpPolicy", env, learning_starts=50).learn(100)


def sbx() -> None:
    """PPO of JAX."""
    import gymnasium as gym
    from sbx import PPO

    PPO("MlpPolicy", gym.make(CART_POLE), n_steps=64, batch_size=64, n_epochs=1).learn(256)


def rl_zoo3() -> None:
    """Its own command, given the package that registers our ids and a file of hyperparameters."""
    from rl_zoo3.train import train

    with tempfile.TemporaryDirectory() as folder:
        settings = Path(folder, "ppo.yml")
        settings.write_text(
            f"{CART_POLE}:\n  n_envs: 2\n  n_timesteps: 256\n  policy: MlpPolicy\n"
            "  n_steps: 64\n  batch_size: 64\n  n_epochs: 1\n"
        )
        sys.argv = [
            *("train", "--algo", "ppo", "--env", CART_POLE, "--gym-packages", "integ_gym"),
            *("--conf-file", str(settings), "--log-folder", folder, "--eval-freq", "-1"),
        ]
        train()


def skrl() -> None:
    """PPO on the vector environment, which `wrap_env` recognizes by itself."""
    import gymnasium as gym
    import torch
    from skrl.agents.torch.ppo import PPO, PPO_CFG
    from skrl.envs.wrappers.torch import wrap_env
    from skrl.memories.torch import RandomMemory
    from skrl.models.torch import DeterministicMixin, GaussianMixin, Model
    from skrl.trainers.torch import SequentialTrainer

    env = wrap_env(gym.make_vec(PENDULUM, num_envs=4))

    spaces = {"observation_space": env.observation_space, "action_space": env.action_space}

    class Actor(GaussianMixin, Model):
        def __init__(self) -> None:
            Model.__init__(self, **spaces)
            GaussianMixin.__init__(self)
            self.net = torch.nn.Linear(env.observation_space.shape[0], 1)
            self.log_std = torch.nn.Parameter(torch.zeros(1))

        def compute(self, inputs: Any, role: str = "") -> Any:
            return self.net(inputs["observations"]), {"log_std": self.log_std}

    class Critic(DeterministicMixin, Model):
        def __init__(self) -> None:
            Model.__init__(self, **spaces)
            DeterministicMixin.__init__(self)
            self.net = torch.nn.Linear(env.observation_space.shape[0], 1)

        def compute(self, inputs: Any, role: str = "") -> Any:
            return self.net(inputs["observations"]), {}

    settings = PPO_CFG(rollouts=32, learning_epochs=1, mini_batches=2)
    settings.experiment.write_interval = settings.experiment.checkpoint_interval = 0
    agent = PPO(
        models={"policy": Actor(), "value": Critic()},
        memory=RandomMemory(memory_size=32, num_envs=4),
        cfg=settings,
        **spaces,
    )
    SequentialTrainer(env=env, agents=agent, cfg={"timesteps": 64, "headless": True}).train()


def torchrl() -> None:
    """A rollout of `GymEnv`, and DQN."""
    import torch
    from torchrl.collectors import Collector
    from torchrl.envs import GymEnv
    from torchrl.modules import QValueActor
    from torchrl.objectives import DQNLoss

    assert GymEnv(PENDULUM, dt=0.025).rollout(5)["action"].shape == (5, 1)
    env = GymEnv(CART_POLE, categorical_action_encoding=True)
    actor = QValueActor(torch.nn.Linear(4, 2), spec=env.action_spec, in_keys=["observation"])
    loss = DQNLoss(actor, action_space=env.action_spec)
    optimizer = torch.optim.Adam(loss.parameters())
    collector = Collector(env, actor, frames_per_batch=64, total_frames=256)
    for batch in collector:
        optimizer.zero_grad()
        loss(batch.reshape(-1))["loss"].backward()
        optimizer.step()
    collector.shutdown()


def rllib() -> None:
    """PPO in one process."""
    import gymnasium as gym
    from ray.rllib.algorithms.ppo import PPOConfig
    from ray.tune.registry import register_env

    import integ_gym  # noqa: F401

    register_env("ours", lambda config: gym.make(CART_POLE, **config))
    config = (
        PPOConfig()
        .environment("ours", env_config={"dt": 0.01, "control_period": 0.02})
        .env_runners(num_env_runners=0)
        .training(train_batch_size_per_learner=256, minibatch_size=64, num_epochs=1)
    )
    algorithm = config.build_algo()
    assert algorithm.train()["num_env_steps_sampled_lifetime"] >= 256
    algorithm.stop()


def cleanrl(checkout: Path, script: str, env_id: str, options: list[str]) -> None:
    """A script of a checkout, as it stands, in what it expects of Gymnasium 0.29."""
    import gymnasium as gym

    _offer_gymnasium_0_29(gym)
    sys.path.insert(0, str(checkout))
    sys.argv = [script, "--env-id", env_id, "--no-cuda", *options]
    folder = Path.cwd()
    with tempfile.TemporaryDirectory() as scratch:
        os.chdir(scratch)
        try:
            runpy.run_path(str(checkout / "cleanrl" / f"{script}.py"), run_name="__main__")
        finally:
            os.chdir(folder)


def _offer_gymnasium_0_29(gym: Any) -> None:
    """What CleanRL calls and newer versions of Gymnasium have changed: names and defaults."""
    transform = gym.wrappers.TransformObservation
    sync = gym.vector.SyncVectorEnv

    class SyncVectorEnv(sync):  # type: ignore[misc, valid-type]
        def __init__(self, env_fns: Any) -> None:
            super().__init__(env_fns, autoreset_mode=gym.vector.AutoresetMode.SAME_STEP)

        def step(self, actions: Any) -> Any:
            *results, infos = super().step(actions)
            if "final_obs" in infos:
                infos["final_observation"] = infos.pop("final_obs")
                infos.pop("final_info")
            return *results, infos

    gym.wrappers.TransformObservation = lambda env, f: transform(env, f, env.observation_space)
    gym.vector.SyncVectorEnv = SyncVectorEnv


_PPO = ["--total-timesteps", "256", "--num-envs", "2", "--num-steps", "64", "--update-epochs", "1"]
_OFF_POLICY = ["--total-timesteps", "300", "--learning-starts", "100", "--buffer-size", "1000"]
CLEANRL = {
    "ppo_continuous_action": (PENDULUM, _PPO),
    "ppo": (CART_POLE, _PPO),
    "dqn": (CART_POLE, _OFF_POLICY),
    "sac_continuous_action": (PENDULUM, _OFF_POLICY),
    "td3_continuous_action": (PENDULUM, _OFF_POLICY),
}

LIBRARIES: dict[str, tuple[str, Callable[[], None]]] = {
    "stable-baselines3": ("stable_baselines3", stable_baselines3),
    "sb3-contrib": ("sb3_contrib", sb3_contrib),
    "sbx": ("sbx-rl", sbx),
    "rl_zoo3": ("rl_zoo3", rl_zoo3),
    "skrl": ("skrl", skrl),
    "torchrl": ("torchrl", torchrl),
    "rllib": ("ray", rllib),
}
"""By name: its package, and what is run."""


def run_one(name: str, checkout: Path | None) -> None:
    """Run one library in this process."""
    import integ_gym  # noqa: F401

    if name in LIBRARIES:
        LIBRARIES[name][1]()
    elif checkout is not None:
        script = name.removeprefix("cleanrl/")
        cleanrl(checkout, script, *CLEANRL[script])


def installed(package: str) -> str | None:
    """Version of a package; None if it is not installed."""
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def revision(checkout: Path) -> str:
    """The version that a checkout says it has."""
    lines_read = (checkout / "pyproject.toml").read_text(encoding="utf-8").splitlines()
    return next((x.split('"')[1] for x in lines_read if x.startswith("version")), "unknown")


def check(name: str, known: str, checkout: Path | None) -> bool:
    """Run a library in a process of its own, and print what came of it."""
    command = [sys.executable, __file__, "--in-this-process", name]
    command += [] if checkout is None else ["--cleanrl", str(checkout)]
    began = time.monotonic()
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=LIMIT, check=False)
        passed, lines = done.returncode == 0, done.stderr.strip().splitlines()
    except subprocess.TimeoutExpired:
        passed, lines = False, [f"not done after {LIMIT} s"]
    took = time.monotonic() - began
    print(f"{'PASS' if passed else 'FAIL'}  {name} {known}  ({took:.0f} s)", flush=True)
    if not passed:
        print("\n".join(f"      {line}" for line in lines[-15:]), flush=True)
    return passed


def main() -> int:
    """Run all that there is; 1 if one failed."""
    names = [*LIBRARIES, *(f"cleanrl/{script}" for script in CLEANRL)]
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", nargs="+", choices=names, default=names, metavar="NAME")
    parser.add_argument("--cleanrl", type=Path, metavar="CHECKOUT", help="a checkout of CleanRL")
    parser.add_argument("--in-this-process", choices=names, help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.in_this_process:
        run_one(asked.in_this_process, asked.cleanrl)
        return 0
    print(", ".join(f"{name} {installed(name)}" for name in SHARED))
    passed = []
    for name in asked.only:
        known = revision(asked.cleanrl) if asked.cleanrl and name not in LIBRARIES else None
        if name in LIBRARIES:
            known = installed(LIBRARIES[name][0])
        if known is None:
            print(f"      {name} is left out: it is not here", flush=True)
        else:
            passed.append(check(name, known, asked.cleanrl))
    return int(not all(passed))


if __name__ == "__main__":
    sys.exit(main())
