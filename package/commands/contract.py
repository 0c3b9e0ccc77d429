"""``integ-gym contract``: whether two environments or cells mean the same before they integrate."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from typing import Final

import msgspec

from integ_gym.eval.contract import STATES, BoundaryCheck, Contract, compare_contracts
from integ_gym.eval.panel.conclusions import contract_words
from integ_gym.support.options import CommandParser, add_named_values, by_name, whole_number
from integ_gym.support.terminal import FITS, plural, print_columns, print_wrapped

EXAMPLES = """\
examples:
  integ-gym contract --env IntegPendulum-v0 engine=native engine=mujoco
  integ-gym contract --env Hopper-v5 dt=0.002 integrator=RK4,dt=0.001
  integ-gym contract Hopper-v5 my_hopper:HopperTestbed
  integ-gym contract --env IntegCartPole-v0 engine=drake engine=pinocchio --json

States are starts of the first environment, and states that a few random
decisions lead to from there. Positions and velocities are matched by their
order. Exit code 3 if something differs.
"""

BROKEN: Final = 3
"""Exit code where something differs."""

MAPS: Final = {
    "observation": "state → observation",
    "command": "action → actuator command",
    "force": "command → generalized force",
    "acceleration": "force, state → acceleration",
    "constraint": "force, state → constraint force",
    "step": "force, state → change in a step",
}


def parser() -> argparse.ArgumentParser:
    """The command's arguments."""
    arguments = CommandParser(
        prog="integ-gym contract",
        description="Compare two environments, or two cells of one, from the same states and "
        "actions before anything is integrated. Four quantities are compared: observation, "
        "actuator command, generalized force, and the acceleration at that instant; of a robot's "
        "model on MJX, MuJoCo Warp or Newton also constraint forces, and what one step changes. "
        f"Both sides get the same inputs to each, so that a fault shows where it is. {FITS}",
        epilog=EXAMPLES,
    )
    where = "an environment's id or testbed; with --env a cell, as NAME=VALUE,NAME=VALUE"
    arguments.add_argument("first", metavar="A", help=where)
    arguments.add_argument("second", metavar="B", help="the other, likewise")
    arguments.add_argument("--env", metavar="ID", help="the environment whose cells A and B are")
    add_named_values(arguments, "--env-arg", "environment argument of both")
    arguments.add_argument(
        "--states", type=whole_number, default=STATES, metavar="N",
        help=f"how many are compared (default: {STATES})",
    )  # fmt: skip
    arguments.add_argument(
        "--seed", type=whole_number, default=0, metavar="N",
        help="seed of states and actions (default: 0)",
    )  # fmt: skip
    arguments.add_argument("--json", action="store_true", help="print the comparison as JSON")
    return arguments


def main(argv: Sequence[str]) -> int:
    """Run the command; returns its exit code."""
    given = parser().parse_args(argv)
    found = compare_contracts(
        given.first,
        given.second,
        given.env,
        environment=by_name(given.env_arg, "--env-arg", {}),
        states=given.states,
        seed=given.seed,
    )
    if given.json:
        print(json.dumps(msgspec.to_builtins(found), indent=2))
    else:
        _print(found)
    return BROKEN if found.broken else 0


def _print(found: Contract) -> None:
    states = plural(found.states, "start of a seed", "starts of the same seeds")
    said = states if found.starts_alone else plural(found.states, "state")
    print_wrapped(f"A: {found.first}")
    print_wrapped(f"B: {found.second}")
    print_wrapped(f"{said}, each with one action")
    print()
    rows = [
        [MAPS[check.boundary], _components(check), *_numbers(check), _result(check)]
        for check in found.checks
    ]
    names = ["boundary", "components", "difference", "allowed", "result"]
    print_columns(names, rows, right=[False, True, True, True, False], colours={"differs": "red"})
    print()
    for words in contract_words(found, "in A", "in B"):
        print_wrapped(f"Contract differs: {words}.")
    for check in found.checks:
        if not check.compared:
            print_wrapped(f"Not compared: {MAPS[check.boundary]}. {_silence(check, found)}")
    if found.starts_alone:
        print_wrapped(
            "Both cannot be set to one state, so starts of one seed are taken to be the same; "
            "a testbed of your own can say more by its method `boundaries`."
        )
    if not found.broken:
        print_wrapped("What was compared is the same.")


def _components(check: BoundaryCheck) -> str:
    return " and ".join(map(str, dict.fromkeys(check.sizes))) if check.compared else "–"


def _numbers(check: BoundaryCheck) -> tuple[str, str]:
    """Largest relative difference, and the one that is allowed."""
    if check.largest is None:
        return "–", "–"
    return f"{check.largest:.0e}" if check.largest else "0", f"{check.tolerance:.0e}"


def _result(check: BoundaryCheck) -> str:
    if not check.compared:
        return "not compared"
    return "differs" if check.differs else "same"


def _silence(check: BoundaryCheck, found: Contract) -> str:
    """Why a boundary was not compared."""
    who = " and ".join({"first": found.first, "second": found.second}[one] for one in check.silent)
    if check.boundary == "acceleration":
        return f"{who}: no acceleration can be had without a step."
    return f"{who}: it cannot be said."
