"""``integ-gym share``: a run as a model and a data set on the Hugging Face Hub."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from integ_gym.eval.share import push, write_cards
from integ_gym.support.files import make_folder
from integ_gym.support.optional import require
from integ_gym.support.options import CommandParser

EXAMPLES = """\
examples:
  integ-gym share runs/panel --repo me/pendulum --cards-only
  integ-gym share runs/panel --repo me/pendulum
"""


def parser() -> argparse.ArgumentParser:
    """The command's arguments."""
    arguments = CommandParser(
        prog="integ-gym share",
        description="Write a model card and a dataset card with a run's answer and matrix, and "
        "push its policies as a model and the whole run as a data set to the Hugging Face Hub. "
        "Pushing takes a token: `hf auth login`, or HF_TOKEN.",
        epilog=EXAMPLES,
    )
    add = arguments.add_argument
    add("run", type=Path, metavar="RUN", help="directory of a finished panel or evaluation")
    add("--repo", required=True, metavar="USER/NAME", help="name of the model and of the data set")
    add("--private", action="store_true", help="make repositories that others cannot see")
    add("--cards-only", action="store_true", help="write the cards and push nothing")
    add(
        "--out", type=Path, metavar="DIR", default=Path("runs/share"),
        help="where cards go (default: runs/share)",
    )  # fmt: skip
    return arguments


def main(argv: Sequence[str]) -> int:
    """Run the command; returns its exit code."""
    given = parser().parse_args(argv)
    require("report", "evidence", "hub")
    cards = write_cards(given.run, make_folder(given.out), given.repo)
    for kind, path in cards.items():
        print(f"Card of the {kind}: {path.resolve()}")
    if not given.cards_only:
        for place in push(given.run, cards, given.repo, given.private):
            print(f"Pushed: {place}")
    return 0
