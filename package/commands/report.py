"""``integ-gym report``: write a panel's page and figures again."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from integ_gym.eval.panel.checking.page import check_finished
from integ_gym.eval.panel.result import FILE_NAME, read_panel
from integ_gym.eval.panel.run import rewriting
from integ_gym.eval.panel.run_directory import MANIFEST
from integ_gym.eval.report.figures import STYLES, write_figures
from integ_gym.eval.report.page import write_report
from integ_gym.support.errors import InputError
from integ_gym.support.options import CommandParser, run_place
from integ_gym.support.storage import is_remote


def parser() -> argparse.ArgumentParser:
    """The command's arguments."""
    arguments = CommandParser(
        prog="integ-gym report",
        description="Write report.html and figures/ anew from a finished panel's panel.json.",
        epilog="examples:\n  integ-gym report runs/panel\n"
        "  integ-gym report runs/panel --style paper",
    )
    place = "a panel's directory, or its place in an object store"
    arguments.add_argument("directory", type=run_place, metavar="DIR", help=place)
    arguments.add_argument(
        "--style", choices=STYLES, default=STYLES[0],
        help="`paper` writes figures/paper beside them: column width, 8 pt, labelled axes, no "
        "titles, the same numbers and ticks",
    )  # fmt: skip
    return arguments


def main(argv: Sequence[str]) -> int:
    """Run the command; returns its exit code."""
    given = parser().parse_args(argv)
    with rewriting(given.directory) as directory:
        _check(directory)
        check_finished(directory)
        written = _write(directory, given.style)
    here = str(directory.resolve())
    print(written.replace(here, given.directory) if is_remote(given.directory) else written)
    return 0


def _write(directory: Path, style: str) -> str:
    """Write the page or the figures; what was written."""
    panel = read_panel(directory / FILE_NAME)
    if style == "paper":
        folder = directory / "figures" / "paper"
        written = write_figures(panel, folder, style)
        return f"Figures: {folder.resolve()} ({len(written)} files)"
    write_figures(panel, directory / "figures")
    return f"Page: {write_report(panel, directory).resolve()}"


def _check(directory: Path) -> None:
    """Check that a panel was finished in a directory.

    Raises:
        ValueError: if not, with what to do.
    """
    if (directory / FILE_NAME).exists():
        return
    if not directory.is_dir():
        raise InputError(f"there is no directory {directory}; give the directory of a panel")
    if (directory / MANIFEST).exists():
        raise InputError(
            f"{directory} holds a panel that is not finished; run the command that began it "
            "again: it goes on where it stopped"
        )
    raise InputError(
        f"{directory} holds no panel; give the directory that `integ-gym panel` or `integ-gym "
        "evaluate` wrote with --out"
    )
