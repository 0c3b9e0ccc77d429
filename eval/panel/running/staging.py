"""Results that wait beside a run until it is decided that they count, and are then put in place.

What works on a unit writes into a folder of its own, laid out as the run's directory is. It is put
in place file by file, markers last, by renaming: as often, and by as many, as may be.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator, Mapping, Sequence
from itertools import count, groupby
from pathlib import Path
from typing import Any

from integ_gym.support.sharing.claims import (
    Claim,
    close_units,
    is_fence,
    was_committed,
)
from integ_gym.support.sharing.folder_files import Gone, SharedFiles
from integ_gym.support.sharing.probing import PROBE
from integ_gym.support.storing.places import as_storage
from integ_gym.support.storing.storage import Storage

WORK = ".work"
"""Folder in a run's directory for what is there only while it is worked on."""

DIVISION = "division.json"
DRIVEN, SHARED = "driven", "shared"
"""Folders in it: of a driver, and of processes that take units by claims."""

UNITS = "units"
"""In a plan: what is to be done, as plain data with names."""

_BLOCK, _DIVISION, _NAME = "block", "division", "name"
_OVER, _ENDED, _FINISHED = "over", "ended", "finished"
_FOLDERS = ("evidence", "policies", "units")
_LAST = "seal.json"


class Desk:
    """Where units are claimed and their results wait.

    Args:
        run: the run's directory, or where else it is kept.
        name: :data:`DRIVEN` or :data:`SHARED`, or the name that the place gave to who holds it.
    """

    def __init__(self, run: Path | Storage, name: str) -> None:
        self.run = as_storage(run)
        self.name = name
        self.folder = f"{WORK}/{name}"
        self.root = self.run.path / self.folder
        self.claims = self.root / "claims"

    def open(self) -> None:
        """Make its folders."""
        for folder in (self.claims, self.root / "staged"):
            folder.mkdir(parents=True, exist_ok=True)

    def claims_of(self, plan: str) -> SharedFiles:
        """Claims on what is in a plan.

        Raises:
            Gone: if the desk is not there any more.
        """
        return self.run.shared(f"{self.folder}/claims/{plan}", self.folder)

    def plan(
        self,
        name: str,
        units: Sequence[Mapping[str, Any]],
        block: int | None = None,
        division: Mapping[str, Any] | None = None,
    ) -> bool:
        """Note what is to be done; False if there is a plan of that name.

        Args:
            name: of the plan: numbers in order, from 0.
            units: what is to be done.
            block: units whose claims lie together; None: all of them.
            division: who is trained together, where this plan tells.

        Raises:
            Gone: if the desk is not there any more.
        """
        content = {UNITS: [*units], _BLOCK: block, _DIVISION: division}
        return self._files.create(f"{name}.json", json.dumps(content))

    def planned(self, name: str) -> dict[str, Any] | None:
        """A plan; None if there is none.

        Raises:
            Gone: if the desk is not there any more, or was closed.
        """
        text = self._files.read(f"{name}.json")
        if text == "":
            raise Gone(f"{self.folder}/{name}.json")
        return None if text is None else dict(json.loads(text))

    def add_plan(
        self, units: Sequence[Mapping[str, Any]], division: Mapping[str, Any] | None = None
    ) -> str:
        """Note what is to be done after all that was noted before; the name of the plan.

        Raises:
            Gone: if the desk was closed.
        """
        for name in map(str, count()):
            if self.plan(name, units, division=division):
                return name
            self.planned(name)
        raise AssertionError

    def check(self) -> None:
        """See that the desk is there.

        Raises:
            Gone: if not.
        """
        self._files.names("")

    def staged(self, claim: Claim) -> Path:
        """Where what was done under a claim waits."""
        return self.run.path / self._staged(claim)

    def stage_pages(self, claim: Claim) -> None:
        """Have all wait that was written into a copy of the run, where it is worked on in one."""
        for name in self.run.changed():
            target = self.staged(claim) / name
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(self.run.path / name, target)

    def hand_in(self, claim: Claim) -> None:
        """Let all see what was done under a claim; it is not decided yet that it counts."""
        self.run.keep(self._staged(claim))

    def put_in_place(self, claim: Claim) -> None:
        """Move what waits to where it belongs; nothing happens where that was done before."""
        _put_in_place(self.run, self._staged(claim))

    def discard(self, claim: Claim) -> None:
        """Remove what waits: another did it."""
        self.run.remove(self._staged(claim))

    def close(self) -> None:
        """Let nobody who works here decide anything more, and put in place what was decided."""
        files = self._files
        if files.read(_OVER) is not None:
            return
        for name in map(str, count()):
            if files.create(f"{name}.json", ""):
                break
            text = files.read(f"{name}.json")
            if not text:
                break
            claims = self.run.shared(f"{self.folder}/claims/{name}")
            for claim in close_units(claims, _blocks(json.loads(text))):
                self.put_in_place(claim)
        files.create(_OVER, _ENDED)
        self.run.end(self.folder, _is_fence)

    def finish(self) -> None:
        """End the desk of a run in which all is done."""
        self._files.create(_OVER, _FINISHED)
        self.run.end(self.folder, _is_fence)

    def division(self) -> Mapping[str, Any] | None:
        """Who is trained together, as its last plan that tells has it; None if none does."""
        found = None
        for name in map(str, count()):
            text = self._files.read(f"{name}.json")
            if not text:
                return found
            found = json.loads(text)[_DIVISION] or found
        return found

    @property
    def was_finished(self) -> bool:
        """Whether all was done that was to be done."""
        return self._files.read(_OVER) == _FINISHED

    @property
    def _files(self) -> SharedFiles:
        return self.run.shared(self.folder, self.folder)

    def _staged(self, claim: Claim) -> str:
        return f"{self.folder}/staged/{claim.unit}@{claim.number}"


def retire(run: Path | Storage, *names: str, own: str | None = None) -> None:
    """End desks that nobody works at any more: put in place what was decided, remove the rest.

    Who still works there, unseen, finds no claim and no folder, and can change nothing.

    Args:
        run: the run's directory, or where else it is kept.
        names: of the desks, where a folder can be taken away in one step.
        own: elsewhere the one that stays, whose number is above those of the others.
    """
    storage = as_storage(run)
    if own is not None:
        for name in earlier(storage, own):
            Desk(storage, name).close()
        return
    for name in names:
        storage.vanish(f"{WORK}/{name}")
    for gone in storage.vanished(f"{WORK}/{DRIVEN}"):
        for staged in _decided(storage.path / gone):
            _put_in_place(storage, f"{gone}/staged/{staged}")
        storage.remove(gone)


def earlier(storage: Storage, own: str) -> list[str]:
    """Names of the desks before one, the last first."""
    numbers = sorted(int(name) for name in storage.folders(WORK) if name.isdecimal())
    return [str(number) for number in reversed(numbers) if number < int(own)]


def clear(run: Path | Storage) -> None:
    """Remove what is there only while a run is worked on, of a folder."""
    storage = as_storage(run)
    for name in (WORK, *(name for name in storage.folders("") if name.startswith(PROBE))):
        storage.remove(name)


def _decided(desk: Path) -> Iterator[str]:
    for staged in (desk / "staged").glob("*"):
        unit, _, number = staged.name.rpartition("@")
        if was_committed(desk / "claims", unit, int(number)):
            yield staged.name


def _put_in_place(storage: Storage, staged: str) -> None:
    names = [name.removeprefix(f"{staged}/") for name in storage.files(staged)]
    for _, together in groupby(sorted(names, key=_order), _order):
        storage.move({f"{staged}/{name}": name for name in together})
    storage.remove(staged)


def _order(name: str) -> int:
    """What rests on others comes after them."""
    folder = name.partition("/")[0]
    if name == _LAST:
        return len(_FOLDERS) + 1
    return _FOLDERS.index(folder) if folder in _FOLDERS else len(_FOLDERS)


def _blocks(plan: Mapping[str, Any]) -> list[list[str]]:
    names = [str(unit[_NAME]) for unit in plan[UNITS]]
    size = plan[_BLOCK] or max(1, len(names))
    return [names[start : start + size] for start in range(0, len(names), size)]


def _is_fence(name: str) -> bool:
    if name.startswith("claims/"):
        return is_fence(name)
    return "/" not in name
