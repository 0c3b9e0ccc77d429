"""``integ-gym watch``: one policy in several discretizations, side by side."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from integ_gym.eval.film import Film, check_writable, show_film
from integ_gym.eval.watch import candidates, side_by_side, watch
from integ_gym.support.errors import InputError
from integ_gym.support.options import CommandParser, whole_number
from integ_gym.support.terminal import print_columns, print_wrapped
from integ_gym.train.policy_files.sidecar import policy_file

EXAMPLES = """\
examples:
  integ-gym watch runs/panel      lists records that are worth a film
  integ-gym watch runs/panel 3f9a --out film.gif
                                  its home, where it was recorded, the truth
  integ-gym watch runs/panel 3f9a --on explicit_euler "rk4 dt=0.0125" truth
  integ-gym watch runs/panel 3f9a
                                  in a window
  integ-gym watch runs/rk4 --seed 12 --on rk4 truth --out film.gif
                                  a policy that `integ-gym train` wrote

A discretization is written as in a panel: INTEGRATOR, if need be with an engine
before it and dt=S after it. What is left out is as in the record, or as at the
policy's home.
"""


def parser() -> argparse.ArgumentParser:
    """The command's arguments."""
    arguments = CommandParser(
        prog="integ-gym watch",
        description="Show one policy from one start in several discretizations side by side, with "
        "what the motor gave, what the numerics gave and the energy there is: in a window, or as "
        "a GIF or MP4.",
        epilog=EXAMPLES,
    )
    add = arguments.add_argument
    add("run", type=Path, metavar="RUN", help="directory of a run, or of a trained policy")
    add(
        "record", nargs="?", metavar="RECORD",
        help="record id or unique prefix; none for a trained policy, or to list records that "
        "are worth a film",
    )  # fmt: skip
    add(
        "--on", nargs="+", action="extend", default=[], metavar="NAME",
        help="discretizations from left to right; default: what the policy was trained on, the "
        "record's own, and the truth",
    )  # fmt: skip
    add("--seed", type=whole_number, metavar="N", help="seed of the start of a trained policy")
    add("--out", type=Path, metavar="FILE", help="film.gif or film.mp4; default: a window")
    add(
        "--own-code", action="store_true",
        help="load the classes that a record or a policy's side-car names as module:Class",
    )  # fmt: skip
    return arguments


def main(argv: Sequence[str]) -> int:
    """Run the command; returns its exit code."""
    given = parser().parse_args(argv)
    if given.record is None and (given.run / "evidence").is_dir():
        if given.on or given.out or given.own_code or given.seed is not None:
            raise InputError(
                f"{given.run} is a run; give the id of one of its records after it, which "
                f"`integ-gym watch {given.run}` lists"
            )
        return _list(given.run)
    if given.out is not None:
        check_writable(given.out)
    film = _film(given)
    for name, success in film.success.items():
        print(
            f"{'succeeds' if success else 'fails   '}  {name.replace('reference dt=', 'truth dt=')}"
        )
    if given.out is None:
        show_film(film)
        return 0
    print(f"Film: {film.write(given.out).resolve()}")
    return 0


def _list(run: Path) -> int:
    """Print records that are worth a film."""
    rows = candidates(run)
    if not rows:
        print_wrapped(f"No evaluated episode of {run} failed.")
        return 0
    print_wrapped(
        "Failed episodes, one of each cell and label, those first whose policy succeeds at home:"
    )
    table = [(r["record_id"][:8], r["cell"], r["failure_label"], str(r["alike"])) for r in rows]
    print_columns(("record", "cell", "label", "episodes"), table)
    print(f"\nFilm: integ-gym watch {run} {table[0][0]} --out film.gif")
    return 0


def _film(given: argparse.Namespace) -> Film:
    if given.record is not None:
        if given.seed is not None:
            raise InputError("--seed is for a trained policy; leave RECORD out")
        return watch(given.run, given.record, given.on, own_code=given.own_code, on_doubt=_warn)
    if given.run.is_dir() and not policy_file(given.run).exists():
        raise InputError(
            f"{given.run} is no trained policy; give the id of one of its records after it"
        )
    if not given.run.exists():
        raise InputError(f"there is no {given.run}; give the directory of a run or of a policy")
    return side_by_side(given.run, given.on, given.seed or 0, own_code=given.own_code)


def _warn(doubt: str) -> None:
    print_wrapped(f"warning: {doubt}", sys.stderr)
