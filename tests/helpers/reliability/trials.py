"""All attacks by name, each tried from a seed, and what comes of a try."""

from __future__ import annotations

import json
import random
import shutil
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from damage import DAMAGES, files_of
from forgery import FORGERIES, make_fit
from hostile import HOSTILE
from interruption import INTERRUPTIONS, ended, release, started
from victim import Task, Victim, command, records_of

from integ_gym.evidence.sealing import SEAL_FILE

REBUILT = 0.05
"""Share of the tries in which the panel's command is run on what was damaged."""


@dataclass
class Outcome:
    """What came of a try.

    Attributes:
        failures: what was not as promised: not named, not ended in a sentence, files left.
        lost: records that are gone after the run was finished.
        doubled: records that are there more than once.
        accepted: commands that took a wrong result.
        note: what was done.
    """

    failures: list[str] = field(default_factory=list)
    lost: int = 0
    doubled: int = 0
    accepted: list[str] = field(default_factory=list)
    note: str = ""

    @property
    def held(self) -> bool:
        """Whether everything was as promised."""
        return not (self.failures or self.lost or self.doubled or self.accepted)


Try = Callable[[Victim, Path, random.Random], Outcome]


def damaged(kind: str) -> Try:
    """Damage a file of a finished run: `verify` names it, nothing is made of it."""

    def attempt(victim: Victim, folder: Path, rng: random.Random) -> Outcome:
        run = victim.copied(folder / "run")
        file = rng.choice(files_of(run))
        DAMAGES[kind](file, victim.other, rng)
        names = _changed(run, victim)
        found = Outcome(note=", ".join(names))
        others = (
            ("the sealed run", "was sealed") if SEAL_FILE in names else ()
        )  # which contradict it
        _verified(run, (*names, *others), found)
        _reported(run, found, harmless=names == (SEAL_FILE,))
        if rng.random() < REBUILT:
            _rebuilt(victim.panel, run, found)
        return found

    return attempt


def forged(kind: str, fit: bool) -> Try:
    """Forge a result, with hashes of records that fit, and markers, page and seal if told."""

    def attempt(victim: Victim, folder: Path, rng: random.Random) -> Outcome:
        run = victim.copied(folder / "run")
        names = FORGERIES[kind](run, victim.other, rng)
        if fit:
            make_fit(run, panel=kind != "forged panel.json")
        else:
            names = (*names, "was changed after the run was sealed", "is not what its unit")
        found = Outcome(note=names[0])
        _verified(run, names, found)
        _reported(run, found)
        return found

    return attempt


def interrupted(kind: str) -> Try:
    """Disturb a run, and finish it: nothing is lost, doubled, wrong or left over."""

    def attempt(victim: Victim, folder: Path, rng: random.Random) -> Outcome:
        run, found = folder / "run", Outcome()
        task = victim.panel if rng.random() < 0.2 else victim.evaluation
        try:
            found.note = f"{task.words[0]}: {INTERRUPTIONS[kind](task, run, rng)}"
            code = ended(started(task, run, 1))
            if code != 0:
                found.failures.append(f"cannot be finished: exit code {code}")
                return found
            _compared(run, task, found)
            code, told = command("evidence", "verify", run)
            left = [x.name for x in run.rglob(".*")]
            found.failures += [told] * (code != 0) + [f"left over: {x}" for x in left]
        except AssertionError as error:
            found.failures.append(str(error))
        finally:
            release(run)
        return found

    return attempt


def read(kind: str) -> Try:
    """Have a stranger's file read: it is, or is refused in a sentence."""

    def attempt(victim: Victim, folder: Path, rng: random.Random) -> Outcome:
        found = Outcome()
        try:
            HOSTILE[kind](victim, folder, rng)
        except Exception as error:  # whatever comes out is what is looked for
            found.failures.append(f"{type(error).__name__}: {error}")
        return found

    return attempt


ATTACKS: dict[str, Try] = {
    **{f"file {kind}": damaged(kind) for kind in DAMAGES},
    **{kind: forged(kind, fit=False) for kind in FORGERIES},
    **{f"{kind}, all made to fit": forged(kind, fit=True) for kind in FORGERIES},
    **{f"hostile {kind}": read(kind) for kind in HOSTILE},
    **{kind: interrupted(kind) for kind in INTERRUPTIONS},
}


def tried(name: str, seed: int, victim: Victim, folder: Path) -> Outcome:
    """Try an attack in an empty folder, which is removed afterwards."""
    with _emptied(folder):
        return ATTACKS[name](victim, folder, random.Random(f"{name} {seed}"))


@contextmanager
def _emptied(folder: Path) -> Iterator[None]:
    folder.mkdir(parents=True)
    try:
        yield
    finally:
        shutil.rmtree(folder)


def _verified(run: Path, names: tuple[str, ...], found: Outcome) -> None:
    code, told = _ended_well("evidence", "verify", run, found=found)
    if code == 0:
        found.failures.append("verify finds nothing")
    elif not any(name in told for name in names):
        found.failures.append(f"verify names something else: {told[-200:]}")


def _reported(run: Path, found: Outcome, harmless: bool = False) -> None:
    code, _ = _ended_well("report", run, found=found)
    if code == 0 and not harmless:
        found.accepted.append("report")


def _changed(run: Path, victim: Victim) -> tuple[str, ...]:
    """Files that are no longer those of the victim, by their path in the run."""
    names = [file.relative_to(victim.run).as_posix() for file in files_of(victim.run)]
    return tuple(name for name in names if _bytes(run / name) != _bytes(victim.run / name))


def _bytes(file: Path) -> bytes | None:
    return file.read_bytes() if file.is_file() else None


def _rebuilt(task: Task, run: Path, found: Outcome) -> None:
    """Run the command again: it refuses, or does what was lost and ends with the same result."""
    code, told = _ended_well(*task.given(run, 1), found=found)
    if code != 0:
        return
    _compared(run, task, found)
    if _cells(run) != _cells(task.done):
        found.accepted.append(f"panel: {told[-100:]}")


def _compared(run: Path, task: Task, found: Outcome) -> None:
    """Count what is lost, doubled or wrong in a run that was finished."""
    expected, records = records_of(task.done), records_of(run)
    held = Counter(name for name, _ in records.elements())
    found.lost += sum(name not in held for name, _ in expected)
    found.doubled += sum(count - 1 for count in held.values())
    found.accepted += [f"record {name}" for name, own in records if (name, own) not in expected]
    if _cells(run) != _cells(task.done):
        found.accepted.append("panel.json")


def _cells(run: Path) -> Any:
    """What ``panel.json`` says of every cell, but for how to look at the records."""
    panel = json.loads((run / "panel.json").read_text(encoding="utf-8"))
    told = [{k: v for k, v in one.items() if k not in ("file", "query")} for one in panel["matrix"]]
    return told, panel["verdicts"]


def _ended_well(*words: object, found: Outcome) -> tuple[int, str]:
    """Exit code and text of a command, which ends without a traceback."""
    try:
        return command(*words)
    except Exception as error:  # whatever comes out is what is looked for
        found.failures.append(f"{words[0]} raises {type(error).__name__}: {error}")
        return 2, str(error)
