"""``integ-gym census``: what every pendulum and cart-pole of the name really does in a step."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from integ_gym.envs.registries import ENGINES
from integ_gym.eval.census.measuring import take_census
from integ_gym.eval.census.page import render_census, row
from integ_gym.eval.census.subjects import PUBLISHED
from integ_gym.support.files import make_folder, replace_file
from integ_gym.support.optional import require
from integ_gym.support.options import CommandParser, display_command
from integ_gym.support.terminal import FITS, keep_on_one_line, print_columns, print_wrapped

from .engines import chosen_engines

EXAMPLES = """\
examples:
  integ-gym census --out runs/census
  integ-gym census --published gymnasium envpool --out runs/published
  integ-gym census --published my_module:MyLibrary --engine mujoco --out census
"""


def parser() -> argparse.ArgumentParser:
    """The command's arguments."""
    arguments = CommandParser(
        prog="integ-gym census",
        description="Step every published environment called pendulum or cart-pole, and both "
        "plants in every installed engine. The states alone show which one-step map each applies, "
        "how often per decision and with which step, and what that does to the energy of a free "
        "motion. DIR gets census.json and census.html, one page that opens offline. Give "
        f"--published or --engine to look at those alone. {FITS}",
        epilog=EXAMPLES,
    )
    add = arguments.add_argument
    add("--out", type=Path, metavar="DIR", required=True, help="where results go")
    add(
        "--published", nargs="+", action="extend", metavar="NAME",
        help=f"libraries, or module:Class of your own; default: {', '.join(PUBLISHED.names())}",
    )  # fmt: skip
    add(
        "--engine", nargs="+", action="extend", metavar="NAME",
        help=f"engines; default: {', '.join(ENGINES.names())}",
    )  # fmt: skip
    return arguments


def main(argv: Sequence[str]) -> int:
    """Run the command; returns its exit code: 1 if something installed could not be looked at."""
    given = parser().parse_args(argv)
    require("report")
    make_folder(given.out)
    everything = given.published is None and given.engine is None
    libraries = PUBLISHED.names() if everything else given.published or ()
    engines = chosen_engines(given.engine) if everything or given.engine else ()
    census = take_census(
        libraries, engines, lambda source: print(f"looking at {source} …", file=sys.stderr)
    )
    document = census.to_json(display_command(["integ-gym", "census", *argv]))
    text = json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False)
    replace_file(given.out / "census.json", text.encode())
    page = replace_file(given.out / "census.html", render_census(document).encode())
    _print(document)
    print(f"Page: {page.resolve()}")
    return 1 if census.failed else 0


_OPTIONAL = ("largest", "off truth by", "speed limit", "off by")


def _print(document: dict[str, Any]) -> None:
    for plant in ("pendulum", "cart_pole"):
        lines = [row(line) for line in document["lines"] if line["plant"] == plant]
        if lines:
            print(f"\n{plant}")
            print_columns(
                list(lines[0]), [list(line.values()) for line in lines], optional=_OPTIONAL
            )
    print()
    for line in document["lines"]:
        for difference in line["differences"]:
            print_wrapped(f"{line['source']} {line['name']} ({line['plant']}): {difference}")
    for source, command in document["missing"].items():
        print_wrapped(f"{source}: not installed; run: {keep_on_one_line(command)}")
    for source, error in document["failed"].items():
        print_wrapped(f"{source}: could not be looked at: {error}")
