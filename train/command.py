"""The command `integ-gym train`, for both trainers and every algorithm."""

from __future__ import annotations

import argparse
import shlex
import sys
from collections.abc import Callable, Sequence
from dataclasses import Field, fields
from pathlib import Path
from typing import Any

from integ_gym.envs.environment import OTHER_TESTBEDS, is_integ_environment
from integ_gym.envs.registries import ENVIRONMENTS
from integ_gym.envs.settings import Settings
from integ_gym.envs.tasks.pendulum import PendulumSwingUp
from integ_gym.support.errors import InputError
from integ_gym.support.options import CommandParser, add_named_values, by_name, whole_number
from integ_gym.support.terminal import print_command, report_errors

from .config import TrainingConfig
from .policy_files.card import format_episode_stats
from .ppo import PPOConfig, make_training_envs
from .runs import ALGORITHMS

_EXAMPLES = """\
examples:
  integ-gym train --integrator rk4 --dt 0.05 --out runs/rk4
  integ-gym train --integrator explicit_euler --dt 0.05 --control-period 0.05 \\
      --start hanging --max-torque 1.0 --seed 3 --out runs/explicit-3
  integ-gym train --env IntegCartPole-v0 --total-steps 100000 --out runs/balance
  integ-gym train --trainer fleet --integrator rk4 --dt 0.05 --out runs/rk4
  integ-gym train --algorithm sac --env Hopper-v5 --integrator Euler
  integ-gym train --env-arg mass=1.2 --env-arg mass_distribution=point
  integ-gym train --engine mujoco --integrator Euler \\
      --env-arg solver.iterations=10 --out runs/ten
  integ-gym train --trainer fleet --control-period 0.05 --env-arg \\
      'mixture=[{"integrator":"rk4","dt":0.05},{"integrator":"rk4","dt":0.025}]'
"""

_OWN_FLAGS = ("env_id", "env_arguments")
_ENV_FIELDS = (
    *(f for f in fields(Settings) if f.name != "solver"),
    *(f for f in fields(PendulumSwingUp) if f.name == "max_torque"),
)


def training_command(
    argv: Sequence[str] | None = None,
    prog: str = "integ-gym train",
    algorithm: str = "ppo",
) -> int:
    """The command `integ-gym train`: 0 on success, 2 after one line about bad input.

    Args:
        argv: words after the command; by default those that the process was given.
        prog: name of the command.
        algorithm: what learns where no flag says it.
    """
    words = list(sys.argv[1:] if argv is None else argv)
    chosen, _ = _algorithm_parser(algorithm).parse_known_args(words)
    given = vars(training_parser(prog, chosen.algorithm).parse_args(words))
    return report_errors(
        prog, lambda: _train(given), mark="error: ", interrupted="no policy was written"
    )


def _train(given: dict[str, Any]) -> int:
    fleet, algorithm = given.pop("trainer") == "fleet", ALGORITHMS[given.pop("algorithm")]
    out, tensorboard = given.pop("out"), given.pop("tensorboard")
    options = {name: given.pop(name) for name in ("progress", "force")}
    config = _config(algorithm.config, given)
    environments = make_training_envs(config)  # refuses what is wrong before a bar appears
    environments.close()
    config.check_actions(environments.single_action_space)
    folder = out or _default_folder(config)
    if fleet:
        if not isinstance(config, PPOConfig):
            raise InputError(f"the fleet trains PPO; train {config.algorithm} with --trainer sb3")
        if not is_integ_environment(config.env_id):
            raise InputError(
                f"the fleet compiles integ-gym's environments; train {config.env_id} with "
                "--trainer sb3"
            )
        from .fleet.training import train_fleet

        (trained,) = train_fleet([config], [folder], workers=0, **options)
    else:
        (trained,) = algorithm.train([config], [folder], tensorboard=tensorboard, **options)
    card = trained.card
    print(
        f"Last {card['last_episodes']['episodes']} training episodes, exploration included: "
        f"{format_episode_stats(card['last_episodes'])}"
    )
    print(f"Policy: {trained.policy} ({card['steps']} steps in {card['wall_seconds']:.0f} s)")
    judge = ("evaluate", trained.policy, "--env", config.env_id, "--out", f"{folder}-judged")
    print("Next: judge it")
    print_command(shlex.join(["integ-gym", *map(str, judge)]))
    return 0


def _algorithm_parser(default: str) -> argparse.ArgumentParser:
    """The flag that the others depend on."""
    arguments = CommandParser(add_help=False, allow_abbrev=False)
    arguments.add_argument(
        "--algorithm",
        choices=ALGORITHMS,
        default=default,
        help="what learns; `--help --algorithm NAME` lists its hyperparameters (default: "
        f"{default})",
    )
    return arguments


def training_parser(
    prog: str = "integ-gym train", algorithm: str = "ppo"
) -> argparse.ArgumentParser:
    """The command's arguments, with the hyperparameters of an algorithm."""
    owner = ALGORITHMS[algorithm].config
    arguments = CommandParser(
        prog=prog,
        description=f"Train a policy by {owner.algorithm} on one discretization of an environment.",
        epilog=_EXAMPLES.replace("integ-gym train", prog),
        argument_default=argparse.SUPPRESS,
        parents=[_algorithm_parser(algorithm)],
    )
    arguments.add_argument(
        "--env",
        dest="env_id",
        help=f"one of {', '.join(ENVIRONMENTS)}, {OTHER_TESTBEDS}",
    )
    arguments.add_argument(
        "--out",
        type=Path,
        default=None,
        help="folder for the policy (default: in runs/, named after environment, integrator, dt "
        "and seed)",
    )
    arguments.add_argument(
        "--force", action="store_true", default=False, help="replace a policy that is there"
    )
    arguments.add_argument(
        "--trainer",
        choices=("sb3", "fleet"),
        default="sb3",
        help="stable-baselines3, or the compiled trainer, which writes no logs (default: sb3)",
    )
    arguments.add_argument(
        "--no-tensorboard",
        dest="tensorboard",
        action="store_false",
        default=True,
        help="write no logs",
    )
    arguments.add_argument(
        "--no-progress",
        dest="progress",
        action="store_false",
        default=True,
        help="show no progress bar",
    )
    environment = arguments.add_argument_group("environment (default: its own)")
    for env_field in _ENV_FIELDS:
        _add_flag(environment, env_field)
    add_named_values(environment, "--env-arg", "another constructor argument")
    learner = arguments.add_argument_group(
        f"run (defaults as shown, unless `{owner.__name__}.of` sets others for the environment)"
    )
    for config_field in fields(owner):
        if config_field.name not in _OWN_FLAGS:
            _add_flag(learner, config_field, shown=True)
    return arguments


def _add_flag(group: Any, of: Field[Any], *, shown: bool = False) -> None:
    """A flag for a parameter, described by the parameter's own metadata."""
    unit = f" [{of.metadata['unit']}]" if of.metadata["unit"] else ""
    default = f" (default: {of.default})" if shown else ""
    described: dict[str, Any] = {"help": f"{of.metadata['meaning']}{unit}{default}"}
    flag = _flag(of.name)
    if of.type == "bool":
        group.add_argument(flag, action=argparse.BooleanOptionalAction, **described)
        return
    if of.type == "tuple[int, ...]":
        described["nargs"] = "+"
    read, metavar = _READERS[str(of.type)]
    group.add_argument(flag, type=read, metavar=metavar, **described)


def _flag(name: str) -> str:
    return f"--{name.replace('_', '-')}"


def _number_or_none(word: str) -> float | None:
    return None if word.lower() == "none" else float(word)


_number_or_none.__name__ = "number"
_READERS: dict[str, tuple[Callable[[str], Any], str]] = {
    "str": (str, "NAME"),
    "int": (whole_number, "N"),
    "float": (float, "X"),
    "float | None": (_number_or_none, "X"),
    "tuple[int, ...]": (whole_number, "N"),
}
"""By a field's type: what reads a flag's value, and what stands for it in the help."""


def _default_folder(config: TrainingConfig) -> Path:
    arguments = config.env_arguments
    chosen = [str(arguments[name]) for name in ("integrator", "dt") if name in arguments]
    return Path("runs") / "-".join([config.env_id, *chosen, f"seed{config.seed}"])


def _config(owner: type[TrainingConfig], given: dict[str, Any]) -> TrainingConfig:
    """The run that the flags describe."""
    arguments = {f.name: given.pop(f.name) for f in _ENV_FIELDS if f.name in given}
    flags = {name: _flag(name) for name in arguments}
    arguments.update(by_name(given.pop("env_arg"), "--env-arg", flags))
    env_id = given.pop("env_id", "IntegPendulum-v0")
    return owner.of(env_id, env_arguments=arguments, **given)
