"""``integ-gym predict``: what to expect of a policy before it is trained."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

from integ_gym.eval import Prediction, predict
from integ_gym.support import (
    NONE,
    CommandParser,
    add_named_values,
    by_name,
    percent,
    print_aligned,
    say,
)

EXAMPLES = """\
examples:
  integ-gym predict --integrator explicit_euler --dt 0.05 --env-arg max_torque=0.7 \\
                    --env-arg start=hanging --env-arg duration=10
  integ-gym predict --integrator symplectic_euler --dt 0.025 --control-period 0.05 \\
                    --env-arg max_torque=0.7 --env-arg start=hanging

Power and force are those of the numerics along a swing-up on the truth; what takes back within
a swing what it gave is reactive. What is lost by reactive force is out of step with the truth,
what is lost by power came by help that the truth does not give (docs/explanation/atlas.md).
"""
_OPTIONS = {
    "env_id": "--env", "integrator": "--integrator", "dt": "--dt",
    "control_period": "--control-period", "engine": "--engine",
}  # fmt: skip
"""Of arguments that are not the environment's further ones."""


def parser() -> argparse.ArgumentParser:
    """The command's arguments."""
    made = CommandParser(
        prog="integ-gym predict",
        description="Say what to expect of a policy that would be trained in a discretization, "
        "without training it: what the numerics give and take there, whether the task can be done, "
        "and how much of its success it would lose on the truth. The law behind it was fitted to "
        "the atlas, see docs/explanation/atlas.md.",
        epilog=EXAMPLES,
    )
    add = made.add_argument
    add("--env", metavar="ID", default="IntegPendulum-v0", help="default: %(default)s")
    add("--integrator", required=True, metavar="NAME", help="that it would be trained on")
    add("--dt", required=True, type=float, metavar="S", help="integration step, s")
    add("--control-period", type=float, metavar="S", help="s; default: the environment's own")
    add("--engine", default="native", metavar="NAME", help="of the integrator; default: native")
    add_named_values(made, "--env-arg", "another constructor argument")
    return made


def main(argv: Sequence[str]) -> int:
    """Run the command; returns its exit code."""
    given = parser().parse_args(argv)
    further = by_name(given.env_arg, "--env-arg", _OPTIONS)
    found = predict(
        given.env,
        integrator=given.integrator,
        dt=given.dt,
        control_period=given.control_period,
        engine=given.engine,
        **further,
    )
    say(_sentence(found), sys.stdout)
    print_aligned(("what", "value", ""), _rows(found), sys.stdout, right=(False, True, False))
    return 0


def _sentence(found: Prediction) -> str:
    name = found.discretization.name
    if not found.reachable:
        return f"No control that was searched for reaches the goal on {name} in time."
    if not found.within:
        return f"Not known of {name}: {_beyond(found)}; {found.loss:z.2f} lost is a mere guess."
    low, high = found.interval
    helped = "" if found.helped is None else f"; {found.helped:z.2f} of it for help of the numerics"
    return (
        f"Policies that learn on {name} are expected to lose {found.loss:z.2f} of their success on "
        f"the truth ({percent(found.level)} interval of a mean over seeds: {low:z.2f} to "
        f"{high:z.2f}){helped}."
    )


def _beyond(found: Prediction) -> str:
    """What the law was not fitted on."""
    own = found.quantities
    if own.env_id != found.fitted_env_id:
        return f"the law was fitted on {found.fitted_env_id}, and is not one of {own.env_id}"
    least, most = found.fitted_on
    if not least <= own.margin <= most:
        return (
            f"the limit of the control is {own.margin:.3g} times the least that the truth takes, "
            f"and the law was fitted on {least:g} to {most:g} times (give the task by --env-arg, "
            "as start=hanging)"
        )
    low, high = found.seen_ratios
    return (
        f"the least limit there is {own.critical_ratio:.2g} of the truth's, and the law was fitted "
        f"where it is {low:.2g} to {high:.2g} of it"
    )


def _rows(found: Prediction) -> list[tuple[str, str, str]]:
    own = found.quantities
    safe = "none" if found.safe_dt is None else f"{found.safe_dt:g} s"
    return [
        ("limit of the control", f"{own.margin:.3g}", "of the least that the truth takes"),
        ("least limit there", f"{own.critical_ratio:.3g}", "of the least that the truth takes"),
        (
            "energy from the numerics",
            percent(own.energy_share, 1, sign=True),
            "of what a greedy swing-up gains",
        ),
        ("power of the numerics", f"{own.power:+.3g}", "of the motor's full power"),
        ("force of the numerics", f"{own.force:.3g}", "of the motor's full force"),
        ("of it reactive", f"{own.reactive_force:.3g}", "which takes back what it gives"),
        ("time to spare", f"{own.time_to_spare:.3g}", "of a greedy swing-up's on the truth"),
        (
            "coarsest safe step",
            safe if found.within else NONE,
            "whose interval ends below a loss of 0.2",
        ),
    ]
