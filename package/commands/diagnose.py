"""``integ-gym diagnose``: what each integrator does to each plant, against theory."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from integ_gym.envs.registries import ENVIRONMENTS
from integ_gym.eval.diagnosis.drift import drift_example
from integ_gym.eval.diagnosis.page import DIAGNOSIS_PAGE, print_diagnosis
from integ_gym.eval.diagnosis.run import Request, diagnose
from integ_gym.support.errors import InputError
from integ_gym.support.optional import require
from integ_gym.support.options import CommandParser, display_command, refuse_unused
from integ_gym.support.processes import cores
from integ_gym.support.terminal import FITS, print_columns, print_wrapped

from .work_options import add_work, workers_of

EXAMPLES = """\
examples:
  integ-gym diagnose              all integrators on all plants
  integ-gym diagnose --plant pendulum --integrator rk4 --dt 0.02 --out runs/rk4
  integ-gym diagnose --plant pendulum --integrator my_module:Heun
                                  measures an integrator of your own
  integ-gym diagnose --plant my_module:Slider --out runs/slider
  integ-gym diagnose --example drift
                                  energy drift: docs/explanation/drift.md
  integ-gym diagnose --example drift --dt 0.01 --out runs/drift-fine
"""


def parser() -> argparse.ArgumentParser:
    """The command's arguments."""
    arguments = CommandParser(
        prog="integ-gym diagnose",
        description="Measure what integrators do to plants: the plant's own consistency, order, "
        "symplecticity, reversibility, free motion, stiffness, damping, friction, contact, "
        "actuation, timestep refinement and latency. Prints what every integrator is and what "
        "does not hold; DIR gets diagnose.html, diagnose.json, figures and one evidence record per "
        f"rollout. docs/reference/diagnose.md explains every section. {FITS}",
        epilog=EXAMPLES,
    )
    add = arguments.add_argument
    add(
        "--env", metavar="ID",
        help=f"diagnose the plant of this environment: {', '.join(ENVIRONMENTS)}, or "
        "module:Id-v0 of your own",
    )  # fmt: skip
    add("--plant", metavar="NAME", help="a plant, or module:Class of your own; default: all")
    add(
        "--integrator", nargs="+", action="extend", default=[], metavar="NAME",
        help="integrators, or module:Class of your own; default: all",
    )  # fmt: skip
    add(
        "--dt", nargs="+", action="extend", default=[], type=float, metavar="S",
        help="integration steps, s; if you give one, its half and its quarter are taken too. The "
        "largest is the control period. With --example: the step of both of its plants",
    )  # fmt: skip
    add("--example", choices=("drift",), help="a worked example instead")
    add(
        "--out", type=Path, metavar="DIR",
        help="where results go, in place of those of an earlier diagnosis (default: runs/diagnose, "
        "for --example runs/NAME)",
    )  # fmt: skip
    add(
        "--all", action="store_true",
        help="print every line: measured, expected, tolerance, and whether it holds",
    )  # fmt: skip
    add_work(arguments)
    return arguments


def main(argv: Sequence[str]) -> int:
    """Run the command; returns its exit code."""
    given = parser().parse_args(argv)
    if given.out is None:
        given.out = Path("runs") / (given.example or "diagnose")
    require("report", "evidence")
    if given.example:
        return _example(given)
    request = Request(given.env, given.plant, given.integrator, given.dt)
    result = diagnose(
        request,
        given.out,
        display_command(["integ-gym", "diagnose", *argv]),
        workers_of(given) or cores(),
        progress=not given.no_progress,
    )
    print_diagnosis(result, sys.stdout, every_line=given.all)
    if not given.all:
        print("\nEvery line: --all, or the page")
    print(f"Page: {(given.out / DIAGNOSIS_PAGE).resolve()}")
    return 0


def _example(given: argparse.Namespace) -> int:
    why = "--example drift has its own plants and prints all of it in a moment"
    refuse_unused(parser(), given, why, ("example", "dt", "out"))
    if len(given.dt) > 1:
        raise InputError("--example drift takes one step; give --dt one number of seconds")
    pendulum, cart_pole, picture = drift_example(given.out, *given.dt)
    for drift in (pendulum, cart_pole):
        print_wrapped(drift.setting)
        rows = [list(row.values()) for row in drift.rows]
        print_columns(list(drift.rows[0]), rows)
        print()
    print(f"Figure: {picture.resolve()}")
    return 0
