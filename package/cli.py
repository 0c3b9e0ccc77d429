"""The ``integ-gym`` command."""

from __future__ import annotations

import argparse
import importlib
import os
import sys
import warnings
from collections.abc import Sequence
from typing import Any, NamedTuple, NoReturn

from integ_gym.support.optional import missing_package
from integ_gym.support.options import CommandParser
from integ_gym.support.terminal import end_quietly, print_wrapped, report_errors, true_minus

LEFT = {"diagnose": "of a diagnosis that is not finished nothing is kept"}
"""What an interruption leaves, of commands where that is not what was finished."""


class Command(NamedTuple):
    """What a command is for, and the smallest extras that it runs with."""

    purpose: str
    extra: str


COMMANDS = {
    "panel": Command("train and evaluate a whole panel (the main job)", "panel"),
    "train": Command("train one policy with PPO", "train"),
    "evaluate": Command("evaluate an existing policy", "report"),
    "check": Command("measure what a discretization costs, in about a minute", "panel"),
    "judge": Command("judge results that were measured elsewhere", "report"),
    "contract": Command("compare what two environments mean before they integrate", "report"),
    "atlas": Command("run one panel at several limits of the control", "panel"),
    "diagnose": Command("check integrators against theory", "report"),
    "engines": Command("measure what every engine really does", "evidence"),
    "census": Command("measure what published pendulums and cart-poles really do", "report"),
    "report": Command("write a panel's page and figures again", "report"),
    "share": Command("push a run to the Hugging Face Hub, with its cards", "report,hub"),
    "watch": Command("show a policy in several discretizations, side by side", "render,report"),
    "play": Command("drive a plant by hand and change its discretization while it moves", "render"),
    "evidence": Command("show, query, verify, seal, export and merge records", "evidence"),
}
"""Command, which the module of its name in ``commands`` runs."""

EXAMPLES = """\
examples:
  integ-gym panel --out runs/panel
  integ-gym train --env IntegPendulum-v0 --integrator rk4 --dt 0.05
  integ-gym evaluate policy.zip --env IntegPendulum-v0 --out runs/mine
  integ-gym check --integrator symplectic_euler --dt 0.05
  integ-gym judge results.csv --home default
  integ-gym contract --env IntegPendulum-v0 engine=native engine=mujoco
  integ-gym diagnose --plant pendulum --integrator rk4
  integ-gym engines
  integ-gym census --out runs/census
  integ-gym share runs/panel --repo me/pendulum
  integ-gym watch runs/panel RECORD --out film.gif
  integ-gym play --env IntegCartPoleSwingUp-v0
  integ-gym evidence query runs/panel "SELECT policy_id, cell,
      avg(success::INT) AS success FROM records GROUP BY ALL"
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command; returns its exit code."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    return end_quietly(lambda: _main(arguments))


def _main(arguments: list[str]) -> int:
    if os.getcwd() not in sys.path:  # for integrators of the user's own, "module:Class"
        sys.path.append(os.getcwd())
    parser = CommandParser(
        prog="integ-gym",
        description="Gymnasium environments in which the discretization is a constructor argument.",
        epilog=_commands() + EXAMPLES,
    )
    parser.add_argument("command", choices=COMMANDS, metavar="COMMAND", help="see below")
    parser.add_argument("rest", nargs=argparse.REMAINDER, metavar="…", help="its arguments")
    parser.add_argument("--version", action=_Version, nargs=0, help="show the version and exit")
    chosen = parser.parse_args(arguments[:1] or ["--help"])
    with warnings.catch_warnings():
        warnings.showwarning = _show_warning
        return report_errors(
            f"integ-gym {chosen.command}",
            lambda: _run(chosen.command, arguments[1:]),
            interrupted=LEFT.get(chosen.command, "what was finished stays"),
        )


def _show_warning(message: Warning | str, *_: Any, **__: Any) -> None:
    """A warning as a command says it, without a line of source."""
    print_wrapped(true_minus(f"warning: {message}"), sys.stderr)


class _Version(argparse.Action):
    """Looks for the version when it is asked for, which takes longer than the help."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> NoReturn:
        from integ_gym.support.optional import package_version

        print(f"integ-gym {package_version('integ-gym')}")
        parser.exit()


def _run(name: str, arguments: Sequence[str]) -> int:
    try:
        command = importlib.import_module(f"integ_gym.commands.{name}")
    except ModuleNotFoundError as error:
        if str(error.name).startswith("integ_gym"):
            raise
        fleet = name == "train" and "--trainer fleet" in " ".join(arguments).replace("=", " ")
        raise missing_package(
            str(error.name), "fleet" if fleet else COMMANDS[name].extra
        ) from error
    return int(command.main(arguments))


def _commands() -> str:
    lines = [f"  {name:<10} {command.purpose}" for name, command in COMMANDS.items()]
    return "\n".join(["commands (each has its own --help):", *lines, "", ""])


if __name__ == "__main__":
    sys.exit(main())
