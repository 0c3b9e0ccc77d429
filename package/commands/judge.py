"""``integ-gym judge``: what results that others measured show, and what they cannot."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import msgspec

from integ_gym.eval.judge import STATUS_WORDS, Judged, answer_of, judge, limitations
from integ_gym.eval.report.page import render_judgement
from integ_gym.eval.result_files import MEASURES, read_results
from integ_gym.eval.verdict import p_text
from integ_gym.support.files import make_folder, replace_file, write_json
from integ_gym.support.optional import require
from integ_gym.support.options import CommandParser, display_command
from integ_gym.support.terminal import NONE, print_columns, print_wrapped

EXAMPLES = """\
examples:
  integ-gym judge results.csv --home default --out runs/judged
  integ-gym judge act=act/seed0/eval_info.json act=act/seed1/eval_info.json \\
                  dp=dp/seed0/eval_info.json dp=dp/seed1/eval_info.json
  integ-gym judge results_seed_101 results_seed_202 --home vanilla
"""


def parser() -> argparse.ArgumentParser:
    """The command's arguments."""
    arguments = CommandParser(
        prog="integ-gym judge",
        description="Judge results that were measured elsewhere, without a simulation: success "
        "and return of each policy in each condition with intervals, policies compared, what is "
        "lost from home, and what cannot be said. DIR gets judge.json and judge.html.",
        epilog=EXAMPLES,
    )
    add = arguments.add_argument
    add(
        "results", nargs="+", metavar="[NAME=]FILE",
        help="a .csv, .parquet or .json table with columns policy, seed, episode, condition, and "
        "success or return; LeRobot's eval_info.json; or what Isaac Lab's robust_eval.py writes. "
        "NAME is the policy where a file names none; files of one NAME are its training seeds",
    )  # fmt: skip
    add("--home", metavar="CONDITION", help="condition that policies were trained in")
    add(
        "--out", type=Path, metavar="DIR", default=Path("runs/judge"),
        help="where results go (default: runs/judge)",
    )  # fmt: skip
    return arguments


def main(argv: Sequence[str]) -> int:
    """Run the command; returns its exit code."""
    given = parser().parse_args(argv)
    require("report", "evidence")
    found = judge(read_results(given.results), given.home)
    make_folder(given.out)
    command = display_command(["integ-gym", "judge", *argv])
    write_json(given.out / "judge.json", msgspec.to_builtins(found))
    page = replace_file(given.out / "judge.html", render_judgement(found, command).encode())
    print_wrapped(answer_of(found), hanging="")
    measures = [name for name in MEASURES if any(name in one.estimates for one in found.judged)]
    rows = [
        (one.policy, one.condition, *(_words(one, name) for name in measures), f"{one.seeds}",
         f"{one.episodes}")
        for one in found.judged
    ]  # fmt: skip
    print_columns(("policy", "condition", *measures, "seeds", "episodes"), rows)
    losses, policies = ("policy", "lost from home"), ("condition", "compared")
    for titles, compared in ((losses, found.losses), (policies, found.policies)):
        if compared:
            print()
            rows = [
                (one.place, f"{one.first} − {one.second}", one.difference.in_words(),
                 p_text(one.p_adjusted).removeprefix("p ").removeprefix("= "),
                 STATUS_WORDS[one.status])
                for one in compared
            ]  # fmt: skip
            print_columns((*titles, "difference", "p", "is"), rows)
    print("\nWhat cannot be said")
    for line in limitations(found):
        print_wrapped(f"- {line}")
    print(f"Page: {page.resolve()}")
    return 0


def _words(one: Judged, name: str) -> str:
    return one.estimates[name].in_words() if name in one.estimates else NONE
