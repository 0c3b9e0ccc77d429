"""``integ-gym census``: what every pendulum and cart-pole of the name really does in a step."""

from __future__ import annotations

import argparse
import json
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from integ_gym.envs.engines import ENGINES
from integ_gym.envs.extras import require
from integ_gym.envs.parameters import unknown_name
from integ_gym.eval.census.page import render
from integ_gym.eval.census.published import PUBLISHED
from integ_gym.eval.census.run import take_census
from integ_gym.eval.census.words import row
from integ_gym.eval.output_folder import make_folder
from integ_gym.evidence.atomic import replace_file
from integ_gym.evidence.command_line import CommandParser
from integ_gym.evidence.extra import pyarrow
from integ_gym.evidence.print_table import print_table

EXAMPLES = """\
examples:
  integ-gym census --out runs/census
  integ-gym census --published gymnasium envpool --out runs/published
  integ-gym census --published my_module:MyLibrary --engine mujoco --out runs/mine
"""


def parser() -> argparse.ArgumentParser:
    """The command's arguments."""
    made = CommandParser(
        prog="integ-gym census",
        description="Step one pendulum and one cart-pole of every installed engine, and every "
        "published environment of that name, and find out from the states alone which one-step map "
        "it applies, how often and with which step; and what it does to the energy of a free "
        "motion. DIR gets census.json and census.html, one page that opens offline. Give "
        "--published or --engine to look at those alone.",
        epilog=EXAMPLES,
    )
    add = made.add_argument
    add("--out", type=Path, metavar="DIR", required=True, help="where results go")
    add(
        "--published", nargs="+", action="extend", metavar="NAME",
        help=f"libraries, or module:Class of your own; default: {', '.join(PUBLISHED.names())}",
    )  # fmt: skip
    add(
        "--engine", nargs="+", action="extend", metavar="NAME",
        help=f"engines; default: {', '.join(ENGINES.names())}",
    )  # fmt: skip
    return made


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; returns its exit code: 1 if something installed could not be looked at."""
    given = parser().parse_args(argv)
    require("report")
    make_folder(given.out)
    libraries, engines = _chosen(given)
    census = take_census(libraries, engines, _tell)
    words = ["integ-gym", "census", *(sys.argv[2:] if argv is None else argv)]
    document = census.to_json(shlex.join(words))
    text = json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False)
    replace_file(given.out / "census.json", text.encode())
    page = replace_file(given.out / "census.html", render(document).encode())
    _print(document)
    print(f"Page: {page.resolve()}")
    return 1 if census.failed else 0


def _chosen(given: argparse.Namespace) -> tuple[list[str], list[str]]:
    for name in given.engine or []:
        if name not in ENGINES.names():
            raise ValueError(unknown_name("engine", name, ENGINES.names()))
    if given.published is None and given.engine is None:
        others = [name for name in ENGINES.names() if name != "native"]
        return list(PUBLISHED.names()), ["native", *others]
    return given.published or [], given.engine or []


def _tell(source: str) -> None:
    print(f"looking at {source} …", file=sys.stderr)


def _print(document: dict[str, Any]) -> None:
    for plant in ("pendulum", "cart_pole"):
        lines = [line for line in document["lines"] if line["plant"] == plant]
        if lines:
            print(f"\n{plant}")
            print_table(pyarrow().Table.from_pylist([row(line) for line in lines]), sys.stdout)
    print()
    for line in document["lines"]:
        for difference in line["differences"]:
            print(f"{line['source']} {line['name']} ({line['plant']}): {difference}")
    for source, command in document["missing"].items():
        print(f"{source}: not installed; run: {command}")
    for source, error in document["failed"].items():
        print(f"{source}: could not be looked at: {error}")
