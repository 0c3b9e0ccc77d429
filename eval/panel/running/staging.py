"""Results that wait beside a run until it is decided that they count, and are then put in place.

What works on a unit writes into a folder of its own, laid out as the run's directory is. It is put
in place file by file, markers last, by renaming: as often, and by as many, as may be.
"""

from __future__ import annotations

import os
import shutil
import uuid
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from integ_gym.support import Claim, was_committed

WORK = ".work"
"""Folder in a run's directory for what is there only while it is worked on."""

DIVISION = "division.json"
DRIVEN, SHARED = "driven", "shared"
"""Folders in it: of a driver, and of processes that take units by claims."""

_GONE = "gone-"
_IN_ORDER = ("evidence", "policies", "units")


class Desk:
    """Where units are claimed and their results wait.

    Args:
        run: the run's directory.
        name: :data:`DRIVEN` or :data:`SHARED`.
    """

    def __init__(self, run: Path, name: str) -> None:
        self.run = run
        self.root = run / WORK / name
        self.claims = self.root / "claims"
        self._staged = self.root / "staged"

    def open(self) -> None:
        """Make its folders."""
        for folder in (self.claims, self._staged):
            folder.mkdir(parents=True, exist_ok=True)

    def staged(self, claim: Claim) -> Path:
        """Where what was done under a claim waits."""
        return self._staged / f"{claim.unit}@{claim.number}"

    def put_in_place(self, claim: Claim) -> None:
        """Move what waits to where it belongs; nothing happens where that was done before."""
        _put_in_place(self.staged(claim), self.run)


def retire(run: Path, *names: str) -> None:
    """End desks that nobody works at any more: put in place what was decided, remove the rest.

    Who still works there, unseen, finds no claim and no folder, and can change nothing.

    Args:
        run: the run's directory.
        names: of the desks.
    """
    work = run / WORK
    for name in names:
        with suppress(FileNotFoundError):
            (work / name).rename(work / f"{_GONE}{uuid.uuid4().hex}")
    for gone in work.glob(f"{_GONE}*"):
        for staged in _decided(gone):
            _put_in_place(staged, run)
        shutil.rmtree(gone, ignore_errors=True)


def clear(run: Path) -> None:
    """Remove what is there only while a run is worked on."""
    shutil.rmtree(run / WORK, ignore_errors=True)


def _decided(desk: Path) -> Iterator[Path]:
    for staged in (desk / "staged").glob("*"):
        unit, _, number = staged.name.rpartition("@")
        if was_committed(desk / "claims", unit, int(number)):
            yield staged


def _put_in_place(staged: Path, run: Path) -> None:
    for folder in _IN_ORDER:
        for file in sorted((staged / folder).rglob("*")):
            if file.is_dir() or file.name.startswith("."):
                continue
            target = run / file.relative_to(staged)
            target.parent.mkdir(parents=True, exist_ok=True)
            with suppress(FileNotFoundError):  # somebody else was faster
                os.replace(file, target)
    shutil.rmtree(staged, ignore_errors=True)
