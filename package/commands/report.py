"""``integ-gym report``: write a panel's page and figures again."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from integ_gym.eval import (
    FILE_NAME,
    MANIFEST,
    STYLES,
    check_finished,
    read_panel,
    write_figures,
    write_report,
)
from integ_gym.support import CommandParser


def parser() -> argparse.ArgumentParser:
    """The command's arguments."""
    made = CommandParser(
        prog="integ-gym report",
        description="Write report.html and figures/ anew from a finished panel's panel.json.",
        epilog="examples:\n  integ-gym report runs/panel\n"
        "  integ-gym report runs/panel --style paper",
    )
    made.add_argument("directory", type=Path, metavar="DIR", help="a panel's directory")
    made.add_argument(
        "--style", choices=STYLES, default=STYLES[0],
        help="`paper` writes figures/paper beside them: column width, 8 pt, labelled axes, no "
        "titles, the same numbers and ticks",
    )  # fmt: skip
    return made


def main(argv: Sequence[str]) -> int:
    """Run the command; returns its exit code."""
    given = parser().parse_args(argv)
    directory = given.directory
    _check(directory)
    check_finished(directory)
    panel = read_panel(directory / FILE_NAME)
    if given.style == "paper":
        folder = directory / "figures" / "paper"
        written = write_figures(panel, folder, given.style)
        print(f"Figures: {folder.resolve()} ({len(written)} files)")
        return 0
    write_figures(panel, directory / "figures")
    page = write_report(panel, directory)
    print(f"Page: {page.resolve()}")
    return 0


def _check(directory: Path) -> None:
    """Check that a panel was finished in a directory.

    Raises:
        ValueError: if not, with what to do.
    """
    if (directory / FILE_NAME).exists():
        return
    if not directory.is_dir():
        raise ValueError(f"there is no directory {directory}; give the directory of a panel")
    if (directory / MANIFEST).exists():
        raise ValueError(
            f"{directory} holds a panel that is not finished; run the command that started it "
            "again, which goes on where it stopped"
        )
    raise ValueError(
        f"{directory} holds no panel; give the directory that `integ-gym panel` or `integ-gym "
        "evaluate` wrote with --out"
    )
