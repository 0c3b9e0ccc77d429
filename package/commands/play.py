"""``integ-gym play``: drive a plant by hand, and change its discretization while it moves."""

from __future__ import annotations

import argparse
from collections.abc import Sequence

from integ_gym.envs.registries import ENVIRONMENTS
from integ_gym.eval.play import Game, play_in_window
from integ_gym.support.optional import require
from integ_gym.support.options import CommandParser, add_named_values, by_name, whole_number
from integ_gym.support.terminal import fixed, print_wrapped

EXAMPLES = """\
examples:
  integ-gym play                        the pendulum, as Gymnasium integrates it
  integ-gym play --env IntegCartPoleSwingUp-v0
  integ-gym play --env IntegCartPole-v0 --integrator rk4 --dt 0.01
  integ-gym play --env-arg max_torque=0.7 --env-arg damping=0.02
  integ-gym play --env IntegQuadrotor-v0 --env-arg way_point_period=4
  integ-gym play --env IntegHopper-v0 --integrator rk4 --dt 0.002

keys:
  Left, Right   push; tilt a quadrotor, turn a hopper's hip
  W, S          the second control: lift a quadrotor or not, stretch or shorten
                a hopper's leg
  Up, Down      a coarser, a finer step
  1 to 9, Tab   the integrator
  Space, R, Esc pause, begin again, leave

The plant keeps its motion while integrator and step change.
MOTOR is the energy that you gave. NUMERICS is what the integrator's errors gave
or, below zero, took; the truth gives none.
"""


def parser() -> argparse.ArgumentParser:
    """The command's arguments."""
    arguments = CommandParser(
        prog="integ-gym play",
        description="Drive a plant with the arrow keys, W and S, switch the integrator and the "
        "step while it moves, and watch where its energy comes from.",
        epilog=EXAMPLES,
    )
    add = arguments.add_argument
    add(
        "--env", default="IntegPendulum-v0", metavar="ID",
        help=f"{', '.join(ENVIRONMENTS)}, or your own as module:Id-v0 (default: IntegPendulum-v0)",
    )  # fmt: skip
    add("--integrator", metavar="NAME", help="the first one (default: the environment's)")
    add("--dt", type=float, metavar="S", help="first step, s (default: the environment's)")
    add_named_values(arguments, "--env-arg", "environment argument")
    add(
        "--seed",
        type=whole_number,
        default=0,
        metavar="N",
        help="seed of the first start (default: 0)",
    )
    return arguments


def main(argv: Sequence[str]) -> int:
    """Run the command; returns its exit code."""
    given = parser().parse_args(argv)
    further = by_name(given.env_arg, "--env-arg", {"integrator": "--integrator", "dt": "--dt"})
    require("render")
    first = {"integrator": given.integrator, "dt": given.dt}
    arguments = {name: value for name, value in first.items() if value is not None}
    game = Game(given.env, {**further, **arguments}, given.seed)
    play_in_window(game)
    ledger = game.ledger()
    print_wrapped(
        f"{game.time:.1f} s: motor {fixed(ledger['motor'], sign=True)} J, numerics "
        f"{fixed(ledger['numerics'], sign=True)} J, losses {fixed(ledger['losses'], sign=True)} J, "
        f"energy now {fixed(ledger['energy'])} J"
    )
    return 0
