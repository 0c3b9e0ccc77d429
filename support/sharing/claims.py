"""Units of work that any number of processes take one by one, each done by one of them.

Everything rests on one operation: to make a file that nobody has made. A unit has a chain of such
files, ``UNIT.1``, ``UNIT.2``, …: whoever makes the next one holds the unit from then on, and its
number is the holder's fencing number. A holder touches its file from time to time. When it has not
done so for a lease, by the file system's own clock, another may make the next file and so take the
unit over. To commit, the holder makes the next file as well, with a word that says so: of a holder
that wakes after its lease and of the one that took over, one alone makes it. What was staged under
the number of the commit is then put in place by whoever finds it, as often as may be.

A plain ``UNIT.done`` follows, so that a listing tells all. Units lie in blocks, and a block of
which all is done gets a file of its own: nobody lists all units, and few look at a block twice.
"""

from __future__ import annotations

import math
import random
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from glob import escape
from pathlib import Path

from .folder_files import Gone, SharedFiles

LEASE = 120.0
"""Time after which a unit whose holder is silent is taken over, s."""

BLOCK = 128
"""Units that are listed together."""

LOOKS = 1
"""Blocks that are listed, at most, before a process that found nothing waits."""

AGES = 8
"""Units of a block whose holders are looked after, at most, in one go."""

AT_ONCE = 16
"""Chains that are ended at the same time."""

MOST_NUMBER = 20
"""A unit that was begun so often and never finished is given up."""

_COMMIT = "commit"
_CLOSED = "closed"
"""Word of a file that ends a chain that nothing was decided in."""

_DONE = "done"
_OVER = "over"
"""Folder of files that are called as the blocks that are done."""

_ALL = f"{_OVER}/all"


class ClaimError(RuntimeError):
    """A unit that nobody finishes, in one sentence."""


@dataclass(frozen=True)
class Claim:
    """A unit that is held.

    Attributes:
        unit: its name.
        number: of the claim, the fencing number: later claims of a unit have higher ones.
        decided: whether a claim of that number was committed, and only its putting in place is
            left to be done.
    """

    unit: str
    number: int
    decided: bool
    _files: SharedFiles
    _block: str

    def renew(self) -> bool:
        """Begin a new lease; False if the unit was taken over."""
        if self._files.exists(self._next):
            return False
        self._files.touch(f"{self._block}/{self.unit}.{self.number}")
        return True

    def commit(self) -> bool:
        """Decide that what is staged under this number counts; False if it was taken over."""
        return self.decided or self._files.create(self._next, _COMMIT)

    def finish(self) -> None:
        """Note that all is in place."""
        self._files.create(f"{self._block}/{self.unit}.{_DONE}", "")

    @property
    def _next(self) -> str:
        return f"{self._block}/{self.unit}.{self.number + 1}"


def was_committed(folder: Path, unit: str, number: int) -> bool:
    """Whether the claim of a number was committed, by the files in a folder and below it."""
    found = folder.rglob(f"{escape(unit)}.{number + 1}")
    return any(file.read_text(encoding="utf-8") == _COMMIT for file in found)


def close_units(files: SharedFiles, blocks: Sequence[Sequence[str]]) -> Iterator[Claim]:
    """End the chains of units: nobody who holds one, or will, can commit it from then on.

    Args:
        files: where the claims are.
        blocks: names of all units, as they lie in blocks.

    Yields:
        Those that were committed before, and that may not be in place.
    """
    with ThreadPoolExecutor(AT_ONCE) as pool:
        for place, units in enumerate(blocks):
            latest = _latest(files.names(str(place)), units)
            undone = {unit: number for unit, number in latest.items() if number >= 0}
            close = partial(_closed, files, str(place))
            for claim in pool.map(close, undone, undone.values()):
                if claim is not None:
                    yield claim


def _closed(files: SharedFiles, block: str, unit: str, latest: int) -> Claim | None:
    """End a unit's chain; its last claim if that was committed."""
    text = files.read(f"{block}/{unit}.{latest}") if latest else ""
    while text not in (_COMMIT, _CLOSED):
        if files.create(f"{block}/{unit}.{latest + 1}", _CLOSED):
            return None
        latest += 1
        text = files.read(f"{block}/{unit}.{latest}")
    return Claim(unit, latest - 1, True, files, block) if text == _COMMIT else None


def is_fence(name: str) -> bool:
    """Whether a file of a unit's chain is one that keeps somebody from committing.

    Nobody can have held a unit under a number before the first.
    """
    _, _, number = name.rpartition(".")
    return number.isdecimal() and int(number) > 1


def _latest(names: Iterable[str], units: Iterable[str]) -> dict[str, int]:
    """Highest number in the chain of each unit; 0: free, -1: finished."""
    numbers = dict.fromkeys(units, 0)
    for name in names:
        unit, _, end = name.rpartition(".")
        if end == _DONE:
            numbers[unit] = -1
        elif numbers.get(unit, -1) >= 0:
            numbers[unit] = max(numbers[unit], int(end))
    return numbers


class Claims:
    """The units of some work, as one process sees them.

    Args:
        files: where the claims are, the same for all processes.
        units: names of all units, the same for all processes, in the same order.
        lease: time after which a unit whose holder is silent is taken over, s.
        seed: of the order in which this process looks at units; by default its own.
        clock: time of this process, s; it decides only when to look again.
        owner: what claims say of their holder, for people.
    """

    def __init__(
        self,
        files: SharedFiles,
        units: Sequence[str],
        lease: float = LEASE,
        seed: int | None = None,
        clock: Callable[[], float] = time.monotonic,
        owner: str = "",
    ) -> None:
        self._files = files
        self._units = units
        self._lease = lease
        self._clock = clock
        self._owner = owner
        self._rng = random.Random(seed)
        blocks = list(range(math.ceil(len(units) / BLOCK)))
        self._rng.shuffle(blocks)
        self._open = deque(blocks)
        self._block = ""
        self._free: list[str] = []
        self._not_before: dict[tuple[str, int], float] = {}

    @property
    def done(self) -> bool:
        """Whether all units are known to be finished."""
        return not self._open

    def take(self) -> Claim | None:
        """Hold a unit that is free, or whose holder is gone; None if none was found now.

        Raises:
            ClaimError: for a unit that was begun too often.
            Gone: if the folder of the claims has vanished.
        """
        claim, looks = self._first_free(), 0
        while claim is None and looks < LOOKS and self._skip_over():
            claim = self._look() or self._first_free()
            looks += 1
        if claim is None:
            self._note_whether_all_is_over()
        return claim

    def seize(self, unit: str) -> Claim:
        """Hold a unit, whoever holds it: for a scheduler that knows that its holder is gone.

        Raises:
            Gone: if the folder of the claims has vanished.
        """
        block, number = self._block_of(unit), 1
        while not self._files.create(f"{block}/{unit}.{number}", self._owner):
            if self._is_decided(block, unit, number):
                return Claim(unit, number - 1, True, self._files, block)
            number += 1
        return Claim(unit, number, False, self._files, block)

    def _is_decided(self, block: str, unit: str, number: int) -> bool:
        """Whether a file of a unit's chain says that it was committed.

        Raises:
            Gone: if it says that the chain was ended.
        """
        text = self._files.read(f"{block}/{unit}.{number}")
        if text == _CLOSED:
            raise Gone(f"{block}/{unit}.{number}")
        return text == _COMMIT

    def _block_of(self, unit: str) -> str:
        return str(self._units.index(unit) // BLOCK)

    def _first_free(self) -> Claim | None:
        """One of the units that the last listing showed as free."""
        while self._free:
            unit = self._free.pop()
            if self._files.create(f"{self._block}/{unit}.1", self._owner):
                return Claim(unit, 1, False, self._files, self._block)
        return None

    def _skip_over(self) -> bool:
        """Leave out blocks that somebody found to be done; whether there are others."""
        if self._open and self._files.exists(f"{_OVER}/{self._open[0]}"):
            over = set(self._files.names(_OVER))
            self._open = deque(block for block in self._open if str(block) not in over)
        return bool(self._open)

    def _note_whether_all_is_over(self) -> None:
        """The first to know that everything is done says so to all others."""
        if self._files.exists(_ALL):
            self._open.clear()
        elif not self._open:
            self._files.create(_ALL, "")

    def _look(self) -> Claim | None:
        """List the next block: note what is free there; else take over what was abandoned."""
        number = self._open.popleft()
        self._block = block = str(number)
        numbers = self._undone(block, self._units[BLOCK * number : BLOCK * (number + 1)])
        if not numbers:
            return None
        self._open.append(number)
        self._free = [unit for unit, latest in numbers.items() if not latest]
        self._rng.shuffle(self._free)
        return None if self._free else self._abandoned(block, numbers)

    def _undone(self, block: str, units: Sequence[str]) -> dict[str, int]:
        """Highest number in the chain of each unit that is not finished; 0: free."""
        numbers = _latest(self._files.names(block), units)
        undone = {unit: number for unit, number in numbers.items() if number >= 0}
        if not undone:
            self._files.create(f"{_OVER}/{block}", "")
        return undone

    def _abandoned(self, block: str, numbers: dict[str, int]) -> Claim | None:
        """Take over a unit whose holder has been silent for a lease."""
        now = self._clock()
        due = [x for x in numbers.items() if now >= self._not_before.get(x, -math.inf)]
        for unit, number in self._rng.sample(due, min(AGES, len(due))):
            age = self._files.age(f"{block}/{unit}.{number}")
            if age is None:
                continue
            if age < self._lease:
                self._not_before[unit, number] = now + self._lease - age
                continue
            claim = self._taken_over(block, unit, number)
            if claim is not None:
                return claim
        return None

    def _taken_over(self, block: str, unit: str, number: int) -> Claim | None:
        if self._is_decided(block, unit, number):
            return Claim(unit, number - 1, True, self._files, block)
        if number >= MOST_NUMBER:
            raise ClaimError(
                f"unit {unit} was begun {number} times and never finished; see what its workers "
                "said, and run the panel without --worker to do it here"
            )
        if self._files.create(f"{block}/{unit}.{number + 1}", self._owner):
            return Claim(unit, number + 1, False, self._files, block)
        return None
