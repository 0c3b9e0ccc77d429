"""``integ-gym check``: what a discretization costs, measured in about a minute."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path

from integ_gym.envs.environment import OTHER_TESTBEDS
from integ_gym.envs.registries import ENVIRONMENTS
from integ_gym.eval.loss_check import Check, check
from integ_gym.eval.panel.spec import TRAINERS
from integ_gym.support import options
from integ_gym.support.terminal import (
    fixed,
    plural,
    print_columns,
    print_wrapped,
    seconds,
)

from .printed import print_headline, print_next
from .work_options import add_work, workers_of

EXAMPLES = """\
examples:
  integ-gym check --integrator symplectic_euler --dt 0.05 \\
                  --env-arg start=hanging --env-arg max_torque=0.7
  integ-gym check --integrator explicit_euler --dt 0.025 \\
                  --control-period 0.05 --seeds 24
  integ-gym check --env IntegCartPole-v0 --integrator explicit_euler --dt 0.02
  integ-gym check --env InvertedPendulum-v5 --integrator Euler --dt 0.02 \\
                  --train-arg total_steps=60000

The same command again goes on where it was interrupted. When it is finished, it
answers at once.
"""
_OPTIONS = {
    "env_id": "--env", "integrator": "--integrator", "dt": "--dt",
    "control_period": "--control-period", "engine": "--engine",
}  # fmt: skip


def parser() -> argparse.ArgumentParser:
    """The command's arguments."""
    arguments = options.CommandParser(
        prog="integ-gym check",
        description="Measure what a discretization costs: train a few seeds in it, judge them "
        "there, at half and at a quarter of the step, and on the truth (the integrator "
        "`reference`; the finest step where there is none), and say what is lost, with its "
        "interval over seeds and starts. About a minute for the pendulum on two idle cores. It "
        "leaves a panel's directory with a record of every episode and a page.",
        epilog=EXAMPLES,
    )
    add = arguments.add_argument
    add(
        "--env", metavar="ID", default="IntegPendulum-v0",
        help=f"{', '.join(ENVIRONMENTS)}, {OTHER_TESTBEDS} (default: %(default)s)",
    )  # fmt: skip
    add("--integrator", required=True, metavar="NAME", help="integrator that policies learn on")
    add("--dt", required=True, type=float, metavar="S", help="integration step, s")
    add(
        "--control-period", type=float, metavar="S",
        help="time between two decisions, s (default: the task's only one, or --dt)",
    )  # fmt: skip
    add("--engine", metavar="NAME", help="engine of the integrator (default: the task's own)")
    options.add_named_values(arguments, "--env-arg", "another constructor argument")
    add(
        "--seeds", type=options.whole_number, metavar="N",
        help="how many train (default: 12, then up to 32 until the interval's half-width is 0.2)",
    )  # fmt: skip
    add(
        "--trainer", choices=TRAINERS,
        help="the compiled fleet trainer or stable-baselines3 (default: the fleet where it can "
        "train the task)",
    )  # fmt: skip
    options.add_named_values(
        arguments, "--train-arg", "a hyperparameter, such as total_steps=100000"
    )
    add(
        "--out", type=Path, metavar="DIR",
        help="directory of the run (default: one in runs/check, named after what is checked)",
    )  # fmt: skip
    add_work(arguments)
    return arguments


def main(argv: Sequence[str]) -> int:
    """Run the command; returns its exit code."""
    given = parser().parse_args(argv)
    found = check(
        given.env,
        integrator=given.integrator,
        dt=given.dt,
        control_period=given.control_period,
        engine=given.engine,
        environment=options.by_name(given.env_arg, "--env-arg", _OPTIONS),
        training=dict(given.train_arg),
        trainer=given.trainer,
        seeds=given.seeds,
        out=given.out,
        workers=workers_of(given),
        progress=not given.no_progress,
        command=options.display_command(["integ-gym", "check", *argv]),
    )
    print_headline(found.panel)
    print_wrapped(_cost(found))
    names = ("judged on", "success", "within twice the time", "lost", "95 % interval")
    print_columns(names, list(_rows(found)), right=(False, True, True, True, True))
    print_next(found.panel)
    print(f"Page: {(found.directory / 'report.html').resolve()}")
    return 0


def _cost(found: Check) -> str:
    """What was run, and what as many seeds again would cost and bring."""
    home = found.panel.rows[0]
    more = found.seeds
    return (
        f"{plural(found.seeds, 'seed')} of {home.training_steps:,} decisions each, a decision "
        f"every {home.control_period:g} s, trained by {found.panel.spec['trainer']['name']}, "
        f"judged from {found.starts} starts each, in {seconds(found.panel.cost.wall_seconds)} "
        "beside starting up and writing the page. "
        f"{plural(more, 'more seed')} (--seeds {found.seeds + more}) would take about "
        f"{seconds(more * found.seconds_per_seed)} and narrow the interval from "
        f"±{found.half_width:.2f} to about ±{found.half_width_with(found.seeds + more):.2f}."
    )


def _rows(found: Check) -> Iterator[tuple[str, ...]]:
    for cell in found.cells:
        name = "home" if cell is found.home else ""
        name = "truth" if found.exact and cell is found.truth else name
        label = f"{name} ({cell.name})" if name == "home" else name or cell.name
        lost = ("", "")
        if cell.loss is not None:
            low, high = cell.loss.ends
            lost = (fixed(cell.loss.estimate), f"{fixed(low)} to {fixed(high)}")
        yield (label, fixed(cell.success), fixed(cell.recovered), *lost)
