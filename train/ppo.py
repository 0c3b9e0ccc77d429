"""Proximal policy optimization with stable-baselines3 (SB3): the reference trainer, in one script.

    python train/ppo.py --env IntegPendulum-v0 --integrator rk4 --dt 0.05 --seed 0 --out runs/rk4

`PPOConfig` holds every hyperparameter, `train` is the whole run. It writes `policy.zip` (an SB3
model), `policy.json` (how it came about) and `tensorboard/`. The same configuration gives the same
weights bit by bit on one machine: one thread, fixed seeds, no GPU.

Source: Schulman et al. (2017), *Proximal policy optimization algorithms*, arXiv:1707.06347.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import Field, dataclass, field, fields
from pathlib import Path
from typing import Any, TypeAlias

import gymnasium as gym
from gymnasium.vector import AutoresetMode, VectorEnv

from integ_gym.envs.extras import load
from integ_gym.envs.integrators import INTEGRATORS
from integ_gym.envs.mixture import Mixture
from integ_gym.envs.parameters import (
    boolean,
    check_values,
    finite,
    nonnegative,
    one_of,
    optional,
    parameter,
    positive,
    text,
    unknown_name,
)
from integ_gym.envs.registration import ENVIRONMENTS, register_environments
from integ_gym.envs.settings import Settings, Setup
from integ_gym.envs.tasks.pendulum_swing_up import PendulumSwingUp
from integ_gym.evidence.command_line import CommandParser, sentence, whole_number
from integ_gym.train.card import episode_summary, make_card
from integ_gym.train.policy import ACTIVATIONS
from integ_gym.train.sb3_model import model_arguments, reproducible, saved
from integ_gym.train.seeds import first_lane_seed
from integ_gym.train.sidecar import TrainedPolicy, claim_folder, write_policy

Wrap: TypeAlias = Callable[[VectorEnv[Any, Any, Any]], VectorEnv[Any, Any, Any]]
"""Wraps the training environments, for example to record their episodes; keeps their API."""


_GIVEN_BY_THE_TRAINER = ("num_envs", "vectorization_mode", "autoreset_mode", "render_mode")


def _nearest_divisor(whole: int, wanted: int) -> int:
    """The divisor of ``whole`` whose ratio to ``wanted`` is nearest to 1."""
    divisors = [n for n in range(1, whole + 1) if whole % n == 0]
    return min(divisors, key=lambda n: abs(math.log(n / wanted)))


class TrainingError(RuntimeError):
    """A run that cannot go on, in one sentence with the remedy."""


def whole(least: int, most: float = math.inf) -> Callable[[Any], str | None]:
    """A whole number of at least ``least`` and at most ``most``."""
    limits = f"{least} or above" if most == math.inf else f"from {least} to {most}"

    def check_whole(value: Any) -> str | None:
        fits = isinstance(value, int) and not isinstance(value, bool) and least <= value <= most
        return None if fits else f"must be a whole number, {limits}"

    return check_whole


def fraction(value: Any) -> str | None:
    """A number in [0, 1]."""
    return None if nonnegative(value) is None and value <= 1 else "must be a number from 0 to 1"


def layer_sizes(value: Any) -> str | None:
    """Sizes of layers."""
    fits = isinstance(value, tuple) and all(whole(1)(size) is None for size in value)
    return None if fits else "must be a list of whole numbers, 1 or above"


def named_values(value: Any) -> str | None:
    """A mapping from names."""
    fits = isinstance(value, Mapping) and all(isinstance(name, str) for name in value)
    return None if fits else "must map argument names to values"


@dataclass(frozen=True)
class PPOConfig:
    """Everything that decides a training run. `PPOConfig.of` has defaults for each environment.

    Raises:
        ValueError: for an impossible value, in one sentence.
    """

    env_id: str = parameter("IntegPendulum-v0", "", "environment", text)
    env_arguments: dict[str, Any] = field(
        default_factory=dict,
        metadata={
            "unit": "",
            "meaning": "constructor arguments, `mixture` among them; those left out take the "
            "environment's defaults",
            "check": named_values,
        },
    )
    seed: int = parameter(
        0, "", "of starts, sensor noise, weights and exploration", whole(0, 2**32 - 1)
    )
    total_steps: int = parameter(
        300_000, "", "decisions of all environments together, rounded up to rollouts", whole(1)
    )
    n_envs: int = parameter(16, "", "environments that advance together", whole(1))
    n_steps: int = parameter(256, "", "decisions per environment in a rollout", whole(1))
    batch_size: int = parameter(256, "", "decisions per gradient step", whole(2))
    n_epochs: int = parameter(10, "", "passes over each rollout", whole(1))
    learning_rate: float = parameter(1e-3, "", "Adam's, at the start", positive)
    learning_rate_end: float | None = parameter(
        None, "", "reached linearly at the end; None: constant", optional(nonnegative)
    )
    discount_time: float = parameter(
        1.0, "s", "τ of the discount per decision, γ = exp(-control_period / τ)", positive
    )
    gae_lambda: float = parameter(
        0.95, "", "λ of generalized advantage estimation, per decision", fraction
    )
    clip_range: float = parameter(0.2, "", "of the probability ratio, around 1", positive)
    ent_coef: float = parameter(0.0, "", "weight of the entropy bonus", nonnegative)
    vf_coef: float = parameter(0.5, "", "weight of the value loss", nonnegative)
    max_grad_norm: float = parameter(0.5, "", "larger gradients are scaled to it", positive)
    normalize_advantage: bool = parameter(True, "", "in each gradient step", boolean)
    target_kl: float | None = parameter(
        None, "", "stop a rollout's passes beyond 1.5 times this; None: never", optional(positive)
    )
    reward_scale: float = parameter(
        0.1, "", "factor on rewards for the learner; all that is reported is unscaled", positive
    )
    net_arch: tuple[int, ...] = parameter(
        (64, 64), "", "sizes of hidden layers, of actor and critic each", layer_sizes
    )
    activation: str = parameter("Tanh", "", "class of torch.nn", one_of(*ACTIVATIONS))
    log_std_init: float = parameter(
        0.0, "", "log of the exploration noise at the start (Box actions)", finite
    )
    trace_every: int = parameter(
        50, "", "every N-th training episode is recorded with its trace", whole(1)
    )

    def __post_init__(self) -> None:
        """Check every value, and that rollouts split into batches."""
        if isinstance(self.net_arch, list):
            object.__setattr__(self, "net_arch", tuple(self.net_arch))
        check_values(PPOConfig, {f.name: getattr(self, f.name) for f in fields(self)})
        if self.env_id not in ENVIRONMENTS:
            raise ValueError(unknown_name("environment", self.env_id, ENVIRONMENTS))
        for name in _GIVEN_BY_THE_TRAINER:
            if name in self.env_arguments:
                raise ValueError(f"`{name}` is not an environment argument; leave it out")
        if self.rollout % self.batch_size:
            raise ValueError(
                f"`batch_size`={self.batch_size} does not divide a rollout of `n_envs` × `n_steps` "
                f"= {self.rollout} decisions; give a divisor, such as "
                f"{_nearest_divisor(self.rollout, self.batch_size)}"
            )

    @classmethod
    def of(cls, env_id: str, **overrides: Any) -> PPOConfig:
        """The defaults that are known to learn an environment, with some values replaced.

        Raises:
            TypeError, ValueError: for unknown or impossible values.
        """
        names = [f.name for f in fields(cls)]
        for name in overrides:
            if name not in names:
                raise TypeError(unknown_name("hyperparameter", name, names))
        return cls(**{"env_id": env_id, **ENVIRONMENT_DEFAULTS.get(env_id, {}), **overrides})

    @property
    def rollout(self) -> int:
        """Decisions between two updates, over all environments."""
        return self.n_envs * self.n_steps

    @property
    def rounded_steps(self) -> int:
        """Decisions that the run will take: whole rollouts."""
        return math.ceil(self.total_steps / self.rollout) * self.rollout

    def discount(self, control_period: float) -> float:
        """γ, the discount per decision, for a control period in s."""
        return math.exp(-control_period / self.discount_time)


ENVIRONMENT_DEFAULTS: dict[str, dict[str, Any]] = {
    "IntegPendulum-v0": {},
    "IntegCartPole-v0": {"total_steps": 100_000, "n_steps": 64},
}
"""Where an environment's defaults differ from those of `PPOConfig`.

Balancing learns from short rollouts, because episodes end early at first: 5 of 5 seeds hold every
start for 10 s after 33 000 decisions, and after 50 000 to 98 000 with rollouts of 256.
"""


def train(
    config: PPOConfig,
    out_dir: str | Path,
    *,
    wrap: Wrap | None = None,
    progress: bool = True,
    on_steps: Callable[[int], None] | None = None,
    tensorboard: bool = True,
    force: bool = False,
) -> TrainedPolicy:
    """Train one policy and write it.

    Nothing outside the run changes: torch's thread count and the global random states are put back.

    Args:
        config: the run.
        out_dir: folder for `policy.zip`, `policy.json` and `tensorboard/`.
        wrap: put around the training environments, whose rewards it sees unscaled.
        progress: show a bar on stderr.
        on_steps: told the number of decisions after each advance.
        tensorboard: write logs.
        force: replace a policy that is already there.

    Raises:
        OSError: if the folder cannot be used, or holds a policy and `force` is not given.
        TypeError, ValueError: for environment arguments that are not possible.
        ModuleNotFoundError: if the extra is missing, with the command that installs it.
    """
    _need_extra(tensorboard)
    folder = claim_folder(out_dir, force)
    vector_env = make_training_envs(config)
    mixture: Mixture = vector_env.unwrapped.mixture  # type: ignore[attr-defined]
    if wrap is not None:
        vector_env = wrap(vector_env)
    try:
        with reproducible():
            model = _make_model(config, vector_env, mixture.setups[0])
            _log_to(model, folder / "tensorboard" if tensorboard else None)
            start = time.perf_counter()
            with _Progress(config.rounded_steps, progress, on_steps) as bar:
                _learn(model, config, bar, _own_integrators(mixture))
            seconds = time.perf_counter() - start
            model.logger.close()
            zip_bytes = saved(model)
    finally:
        vector_env.close()
    card = make_card(
        config,
        mixture,
        trainer="sb3",
        packages=("stable-baselines3", "torch"),
        steps=int(model.num_timesteps),
        seconds=seconds,
        last_episodes=_last_episodes(model),
    )
    return write_policy(folder, zip_bytes, card, vector_env.single_action_space)


def _learn(model: Any, config: PPOConfig, callback: Any, integrators: Iterable[str]) -> None:
    """Train.

    Raises:
        TrainingError: if the weights are no longer finite, or one of ``integrators`` fails.
    """
    try:
        model.learn(config.total_steps, callback=callback)
    except Exception as error:
        failed = INTEGRATORS.at_work(error, integrators)
        if failed:
            raise TrainingError(
                f"the integrator {failed[0]!r} failed: {type(error).__name__}: {error}; "
                "docs/adding.md says what an integrator must be"
            ) from error
        if not isinstance(error, ValueError):
            raise
        raise TrainingError(
            "training broke down: the policy's weights are no longer finite; lower "
            f"`learning_rate`={config.learning_rate:g}"
        ) from error


def _own_integrators(mixture: Mixture) -> tuple[str, ...]:
    """References to integrators of the user's own."""
    names = (setup.settings.integrator for setup in mixture.setups)
    return tuple(dict.fromkeys(name for name in names if ":" in name))


def make_training_envs(config: PPOConfig) -> VectorEnv[Any, Any, Any]:
    """The training environments, which reset within the step that ends an episode.

    Raises:
        TypeError, ValueError: for arguments that are not possible.
    """
    register_environments()
    return gym.make_vec(
        config.env_id,
        num_envs=config.n_envs,
        vectorization_mode="vector_entry_point",
        autoreset_mode=AutoresetMode.SAME_STEP.value,
        **config.env_arguments,
    )


def _make_model(config: PPOConfig, vector_env: VectorEnv[Any, Any, Any], setup: Setup) -> Any:
    """SB3's PPO, with episodes monitored before rewards are scaled."""
    from stable_baselines3 import PPO
    from stable_baselines3.common.vec_env import VecMonitor

    from integ_gym.train.vec_env import Sb3VecEnv, ScaledRewards

    episodes = VecMonitor(Sb3VecEnv(vector_env, info_keys=("success",)))
    scaled = ScaledRewards(episodes, config.reward_scale)
    model = PPO("MlpPolicy", scaled, **model_arguments(config, setup.timing.control_period))
    episodes.seed(first_lane_seed(config.seed))
    return model


def _log_to(model: Any, folder: Path | None) -> None:
    """Log to TensorBoard, or not at all."""
    from stable_baselines3.common.logger import Logger, TensorBoardOutputFormat

    outputs: list[Any] = [] if folder is None else [TensorBoardOutputFormat(str(folder))]
    model.set_logger(Logger(None if folder is None else str(folder), outputs))


class _Progress:
    """A bar over the decisions taken, with return and success of the last episodes.

    Args:
        total: decisions of the whole run.
        shown: whether there is a bar at all.
        on_steps: told the decisions of each advance.
    """

    def __init__(
        self, total: int, shown: bool, on_steps: Callable[[int], None] | None = None
    ) -> None:
        from tqdm import tqdm

        self._on_steps = on_steps
        self._done = 0

        self._bar = tqdm(total=total, desc="PPO", unit=" steps", unit_scale=True, disable=not shown)
        self._episode_ended = False

    def __enter__(self) -> _Progress:
        return self

    def __exit__(self, *exception: object) -> None:
        self._bar.close()

    def __call__(self, variables: dict[str, Any], _: dict[str, Any]) -> bool:
        """Called by SB3 after every step of the environments; True goes on."""
        model = variables["self"]
        if self._episode_ended:  # SB3 counts the episodes of a step after this call
            self._bar.set_postfix_str(_told(_last_episodes(model)), refresh=False)
        advanced = model.num_timesteps - self._done
        self._done = model.num_timesteps
        self._bar.update(advanced)
        if self._on_steps is not None:
            self._on_steps(advanced)
        self._episode_ended = bool(variables["dones"].any())
        return True


def _last_episodes(model: Any) -> dict[str, Any]:
    """The last (up to 100) episodes of training."""
    returns = [float(episode["r"]) for episode in model.ep_info_buffer]
    return episode_summary(returns, [float(success) for success in model.ep_success_buffer])


def _told(episodes: Mapping[str, Any]) -> str:
    """Return and success in a few words."""
    if not episodes["episodes"]:
        return "no episode ended yet"
    success = episodes["success_rate"]
    told = f"return {episodes['return_mean']:.1f}"
    return told if success is None else f"{told}, success {success:.2f}"


def _need_extra(tensorboard: bool) -> None:
    """Import what the extra brings.

    Raises:
        ModuleNotFoundError: with the command that installs it.
    """
    for name in ("torch", "stable_baselines3", "tqdm", *(["tensorboard"] if tensorboard else [])):
        load(name, "train")


# --- command line ----------------------------------------------------------------------------

_EXAMPLES = """\
examples:
  integ-gym train --integrator rk4 --dt 0.05 --out runs/rk4
  integ-gym train --integrator explicit_euler --dt 0.05 --control-period 0.05 \\
      --start hanging --max-torque 1.0 --seed 3 --out runs/explicit-3
  integ-gym train --env IntegCartPole-v0 --total-steps 100000 --out runs/balance
  integ-gym train --trainer fleet --integrator rk4 --dt 0.05 --out runs/rk4
  integ-gym train --env-arg mass=1.2 --env-arg mass_distribution=point --out runs/heavy
  integ-gym train --trainer fleet --control-period 0.05 --out runs/mixed --env-arg \\
      'mixture=[{"integrator": "rk4", "dt": 0.05}, {"integrator": "explicit_euler", "dt": 0.025}]'
"""

_OWN_FLAGS = ("env_id", "env_arguments")
_ENV_FIELDS = (*fields(Settings), *(f for f in fields(PendulumSwingUp) if f.name == "max_torque"))


def main(argv: Sequence[str] | None = None) -> int:
    """The command `integ-gym train`: 0 on success, 2 after one line about bad input."""
    command = parser()
    given = vars(command.parse_args(argv))
    names = ("out", "force", "tensorboard", "progress", "trainer")
    out, force, tensorboard, progress, trainer = (given.pop(name) for name in names)
    try:
        config = _config(given)
        if trainer == "sb3":
            _need_extra(tensorboard)
        make_training_envs(config).close()
        claim_folder(out, force)
    except (ValueError, TypeError, OSError, ModuleNotFoundError) as error:
        print(f"{command.prog}: error: {sentence(error)}", file=sys.stderr)
        return 2
    try:
        if trainer == "fleet":
            trained = _train_with_fleet(config, out, progress, force)
        else:
            trained = train(config, out, progress=progress, tensorboard=tensorboard, force=force)
    except KeyboardInterrupt:
        print(f"{command.prog}: interrupted; no policy was written", file=sys.stderr)
        return 130
    except (TrainingError, ValueError, ModuleNotFoundError) as error:
        print(f"{command.prog}: error: {sentence(error)}", file=sys.stderr)
        return 2
    card = trained.card
    print(f"policy: {trained.policy} ({card['steps']} steps in {card['wall_seconds']:.0f} s)")
    print(
        f"last {card['last_episodes']['episodes']} training episodes, exploration included: "
        f"{_told(card['last_episodes'])}"
    )
    return 0


def _train_with_fleet(config: PPOConfig, out: Path, progress: bool, force: bool) -> TrainedPolicy:
    from integ_gym.train.fleet import train_fleet

    return train_fleet([config], [out], progress=progress, force=force)[0]


def parser() -> argparse.ArgumentParser:
    """The command's arguments."""
    made = CommandParser(
        prog="integ-gym train",
        description="Train a policy with PPO on one discretization of an environment.",
        epilog=_EXAMPLES,
        argument_default=argparse.SUPPRESS,
    )
    made.add_argument("--env", dest="env_id", help=f"one of {', '.join(ENVIRONMENTS)}")
    made.add_argument("--out", type=Path, required=True, help="folder for the policy")
    made.add_argument("--force", action="store_true", default=False, help="replace a policy")
    made.add_argument(
        "--trainer",
        choices=("sb3", "fleet"),
        default="sb3",
        help="stable-baselines3, or the compiled trainer, which writes no logs (default: sb3)",
    )
    made.add_argument(
        "--no-tensorboard", dest="tensorboard", action="store_false", default=True, help="no logs"
    )
    made.add_argument(
        "--no-progress", dest="progress", action="store_false", default=True, help="no bar"
    )
    environment = made.add_argument_group("environment (default: its own)")
    for env_field in _ENV_FIELDS:
        _add_flag(environment, env_field)
    environment.add_argument(
        "--env-arg",
        action="append",
        type=named_value,
        metavar="NAME=VALUE",
        help="any other constructor argument",
    )
    learner = made.add_argument_group(
        "run (defaults as shown, but for what `PPOConfig.of` sets for an environment)"
    )
    for config_field in fields(PPOConfig):
        if config_field.name not in _OWN_FLAGS:
            _add_flag(learner, config_field, shown=True)
    return made


def _add_flag(group: Any, of: Field[Any], *, shown: bool = False) -> None:
    """A flag for a parameter, described by the parameter's own metadata."""
    unit = f" [{of.metadata['unit']}]" if of.metadata["unit"] else ""
    default = f" (default: {of.default})" if shown else ""
    described: dict[str, Any] = {"help": f"{of.metadata['meaning']}{unit}{default}"}
    flag = f"--{of.name.replace('_', '-')}"
    if of.type == "bool":
        group.add_argument(flag, action=argparse.BooleanOptionalAction, **described)
        return
    if of.type == "tuple[int, ...]":
        described["nargs"] = "+"
    group.add_argument(flag, type=_READERS[str(of.type)], metavar=_metavar(of), **described)


def _metavar(of: Field[Any]) -> str:
    return {"str": "NAME", "int": "N", "tuple[int, ...]": "N"}.get(str(of.type), "X")


def _number_or_none(word: str) -> float | None:
    return None if word.lower() == "none" else float(word)


_number_or_none.__name__ = "number"
_READERS: dict[str, Callable[[str], Any]] = {
    "str": str,
    "int": whole_number,
    "float": float,
    "float | None": _number_or_none,
    "tuple[int, ...]": whole_number,
}


def named_value(word: str) -> tuple[str, Any]:
    """``name=value``, the value read as JSON where it is JSON, else as text."""
    name, equals, value = word.partition("=")
    if not equals or not name:
        raise argparse.ArgumentTypeError(f"expected NAME=VALUE, got {word!r}")
    try:
        return name, json.loads(value)
    except ValueError:
        return name, value


def _config(given: dict[str, Any]) -> PPOConfig:
    """The run that the flags describe."""
    arguments = {f.name: given.pop(f.name) for f in _ENV_FIELDS if f.name in given}
    arguments.update(given.pop("env_arg", []))
    env_id = given.pop("env_id", PPOConfig.env_id)
    return PPOConfig.of(env_id, env_arguments=arguments, **given)


if __name__ == "__main__":
    raise SystemExit(main())
