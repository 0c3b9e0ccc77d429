"""A panel's directory: who it belongs to, which units are finished, and one runner at a time."""

from __future__ import annotations

import copy
import hashlib
import json
import math
import shutil
import sys
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import msgspec

from integ_gym.evidence.schema import Finding
from integ_gym.evidence.sealing import SEAL_FILE, find_broken_seals, restore_seal, suspend_seal
from integ_gym.support.errors import IntegGymError
from integ_gym.support.files import (
    Kinds,
    file_hash,
    read_object,
    remove_leftovers,
    replace_file,
    write_files,
    write_json,
)
from integ_gym.support.optional import installed_versions
from integ_gym.support.storage import LOCK, BusyError, Storage

from ..verdict import Looks, Shares
from .plan import GROWING, additions, contradictions

MANIFEST = "run.json"
PANEL_FILE = "panel.json"
FIGURES = "figures"

WORK = ".work"
"""Folder in a run's directory for what is there only while it is worked on."""

PACKAGES = ("integ-gym", "numpy", "scipy", "gymnasium")
"""Packages whose version can change a result of every run."""


RECORDS = "records"
"""Of a marker: SHA-256 of the unit's records; null where no training episode came to its end."""

ADOPTED = "adopted"
"""Of a marker: true where another run did the unit, whose time is not this run's."""

AFTER = "after"
"""Of a marker: hash of the looks at verdicts that there had been, of none too."""

FIRST = "first"
"""Of a marker: the first episode of what was evaluated or tried."""

CALLED, GIVEN = "called", "given"
"""Of a manifest: how the run was called when its page was written; what is known of a policy that
was given."""

_LOOKS = "looks"
"""Of a manifest: what there was at every look at verdicts, in order."""

_OF_MANIFEST: Kinds = {"specification": dict, "versions": dict}
_NOTED: Kinds = {"key": str, "start": float, "end": float, "seconds": float}
_NOTED_BY: dict[str, Kinds] = {
    "train": {"policy": str, RECORDS: (str, type(None))},
    "evaluate": {FIRST: int, "policies": dict, "cells": dict, RECORDS: str},
    "achieve": {
        FIRST: int, "cell": str, "success": list, "recovered": list, "search": (dict, type(None)),
    },
    "contract": {"home": dict, "place": dict, "contract": (dict, type(None))},
}  # fmt: skip
"""What a manifest holds, and a marker, and by the first word of the unit's name what else."""

_MAY_SAY = (CALLED, GIVEN, _LOOKS)
_MAY_NOTE = (RECORDS, "card", AFTER, ADOPTED)
"""What else a manifest may hold, and a marker; nothing that they hold goes unread."""


class RunDirectoryError(IntegGymError, ValueError):
    """A directory that a run cannot use, in one sentence with the remedy."""


def package_versions() -> dict[str, str]:
    """Versions of Python and of the packages that every run's results depend on."""
    return installed_versions(PACKAGES)


class Seen(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """What there was at a look at verdicts.

    Attributes:
        seeds: training seeds of the rows that the family names.
        episodes: starts of each.
        natives: declared transfers whose cell had policies trained in it.
        spent: of a look in another run, whose policies were taken: shares of the level that it
            spent there, on "overfitting > 0.2" and on "overfitting within ±0.1".
    """

    seeds: int
    episodes: int
    natives: int
    spent: tuple[float, float] | None = None


def spent_by(seen: Sequence[Seen], planned: Sequence[int]) -> list[Shares]:
    """Shares of the level that every look of a run spends.

    Args:
        seen: what there was at each, in order.
        planned: seeds at the looks that were planned.
    """
    before = looks_before(seen, planned)
    return [
        one.shares(look.seeds) if look.spent is None else Shares(*look.spent)
        for one, look in zip(before, seen, strict=False)
    ]


def looks_before(seen: Sequence[Seen], planned: Sequence[int]) -> list[Looks]:
    """The looks before every look of a run, and before the next."""
    found = [Looks((), tuple(planned))]
    for look in seen:
        found.append(found[-1].then(look.seeds if look.spent is None else Shares(*look.spent)))
    return found


class RunDirectory:
    """Directory of one run, with the markers of its finished units.

    A unit of work is finished when its marker ``units/NAME.json`` exists; the marker is written
    last and in one step. Files of a unit without a marker are remains of a killed run.

    Args:
        path: the directory, or where else the run is kept.
        specification: what the run is; another one in the same directory is refused, but for
            one with more seeds, episodes, rows, cells or perturbations.
        engines: versions of the distributions behind foreign engines; so are others of them.
    """

    def __init__(
        self,
        path: Path | Storage,
        specification: Mapping[str, Any],
        engines: Mapping[str, str] | None = None,
    ) -> None:
        self.storage = Storage(path) if isinstance(path, Path) else path
        self.path = self.storage.path
        self.evidence = self.path / "evidence"
        self.policies = self.path / "policies"
        self._units = self.path / "units"
        self.looks_before: list[Any] | None = None
        """Looks at verdicts of the run that units are done for; by default ``run.json`` tells."""

        self._specification = json.loads(json.dumps(specification))
        self._engines = dict(engines or {})
        self.was_sealed = False
        """Whether what is in it was sealed when it was opened, and was as it was sealed."""

    def versions(self) -> dict[str, str]:
        """Versions of Python and of all packages that this run's results depend on."""
        trainer = self._specification.get("trainer", {})
        trained = {name: version for name, version in trainer.items() if name != "name" and version}
        return {**package_versions(), **trained, **self._engines}

    @contextmanager
    def opened(self) -> Iterator[None]:
        """Create or check the directory and hold it for one driver.

        Raises:
            RunDirectoryError: if it holds another run, another version's results or other files,
                or if another driver works in it.
        """
        self.storage.fetch(MANIFEST)
        self._check()
        others = self.storage.names() if not (self.path / MANIFEST).exists() else []
        if others:
            raise RunDirectoryError(
                f"{self.storage} holds {others[0]} and no panel; give another place with --out"
            )
        self.make_folders()
        with self.locked():
            self.storage.fetch()
            written = (self.path, self.evidence, self._units, self.path / FIGURES)
            for folder in (*written, *self.policies.iterdir()):
                remove_leftovers(folder, age=0.0)
            self._check()
            self.suspend_seal()
            try:
                self._write_manifest()
                self.storage.send()
                yield
            finally:
                restore_seal(self.path)
                self.storage.send()

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Hold the directory as it is, for one driver.

        Raises:
            RunDirectoryError: if another driver works in it.
        """
        try:
            with self.storage.locked():
                yield
        except BusyError as error:
            raise RunDirectoryError(str(error)) from None

    def finish_work(self) -> None:
        """Remove what is there only while it is worked on: all is done."""
        shutil.rmtree(self.path / WORK, ignore_errors=True)
        self.storage.send()

    def copy_for_workers(self) -> RunDirectory:
        """The same for processes of other machines, which do not see it; see :meth:`moved`."""
        sent = copy.copy(self)
        sent.looks_before = self.read_looks()
        return sent

    def moved(self, folder: Path) -> RunDirectory:
        """The same in another folder, which is new: what is done there is put here afterwards."""
        there = RunDirectory(folder, self._specification, self._engines)
        there.looks_before = self._looks_so_far()
        there.make_folders()
        return there

    def take(self, files: Mapping[str, bytes]) -> None:
        """Put files of units that were done elsewhere in place, markers last."""
        names = sorted(files, key=lambda name: name.startswith("units/"))
        write_files(self.path, {name: files[name] for name in names})

    def make_folders(self) -> None:
        """Make the folders of a run."""
        for folder in (self.evidence, self.policies, self._units):
            folder.mkdir(parents=True, exist_ok=True)

    def suspend_seal(self) -> None:
        """Put the seal of a finished run aside, whose files may now be added to.

        What is missing or has lost its end is done again, and ``panel.json`` is written anew;
        units' records and policies are checked where they are built on.

        Raises:
            RunDirectoryError: if another file is not what was sealed.
        """
        restore_seal(self.path)
        broken = list(find_broken_seals(self.path))
        self.was_sealed = (self.path / SEAL_FILE).exists() and not broken
        for finding in broken:
            path = self.path / finding.file
            known = path.parent == self.evidence and self._marker(path.stem).exists()
            if path.exists() and not known and path.name not in (PANEL_FILE, SEAL_FILE):
                raise RunDirectoryError(
                    f"{self._place_words(path)} {finding.message}; restore it from a copy, or give "
                    "another directory with --out"
                )
        suspend_seal(self.path)

    def record_look(self, seen: Seen) -> None:
        """Note that verdicts are about to be seen, unless they were seen on the same."""
        looks = self.looks()
        if not looks or looks[-1] != seen:
            self._note_looks([*looks, seen])

    def inherit_looks(self, source: RunDirectory) -> None:
        """Note the looks of a run whose policies are taken from there, with what they spent."""
        seen = source.looks()
        planned = source.manifest()["specification"].get("looks", [])
        spent = [(one.exceeds, one.equivalent) for one in spent_by(seen, planned)]
        theirs = [msgspec.structs.replace(one, spent=x) for one, x in zip(seen, spent, strict=True)]
        known = self.looks()
        self._note_looks([*known, *(one for one in theirs if one not in known)])

    def _note_looks(self, looks: Sequence[Seen]) -> None:
        if looks:
            self.note(**{_LOOKS: msgspec.to_builtins(looks)})

    def looks(self) -> list[Seen]:
        """What there was at every look at verdicts, in order."""
        return _looks_in(self.manifest())

    def lost_looks(self, all_say: bool = True) -> Iterator[str]:
        """Units that were finished after other looks than ``run.json`` tells.

        Args:
            all_say: whether every unit must say after which; those of earlier versions do not.
        """
        looks = self.read_looks()
        known = {hash_of_looks(looks[:count]) for count in range(len(looks) + 1)}
        for unit, held in self.readable_markers("")[0].items():
            if held.get(AFTER) not in known and (all_say or AFTER in held):
                yield unit

    def _looks_so_far(self) -> list[Any]:
        return self.read_looks() if self.looks_before is None else self.looks_before

    def read_looks(self) -> list[Any]:
        """The looks at verdicts that ``run.json`` tells, in order."""
        manifest = self.path / MANIFEST
        return list(read_manifest(manifest).get(_LOOKS, [])) if manifest.exists() else []

    def manifest(self) -> dict[str, Any]:
        """What ``run.json`` says.

        Raises:
            RunDirectoryError: if it is damaged.
        """
        return read_manifest(self.path / MANIFEST)

    def note(self, **entries: Any) -> None:
        """Note something in ``run.json``, unless it is there already."""
        manifest = self.manifest()
        if {**manifest, **entries} != manifest:
            write_json(self.path / MANIFEST, {**manifest, **entries})

    def _write_manifest(self) -> None:
        manifest = self.path / MANIFEST
        held = read_manifest(manifest) if manifest.exists() else {}
        before = held.get("specification")
        updated = {**held, "specification": self._specification}
        if before != self._specification:
            updated["versions"] = {**self.versions(), **held.get("versions", {})}
        if updated != held:
            write_json(manifest, updated)
        new = list(additions(before, self._specification)) if before else []
        if new:
            print(f"New in {self.storage}: {'; '.join(new)}. All else is kept.", file=sys.stderr)

    def _check(self) -> None:
        manifest = self.path / MANIFEST
        if manifest.exists():
            self._check_manifest(manifest)
        elif self.path.exists() and not self._is_bare() and not manifest.exists():
            raise RunDirectoryError(
                f"{self.storage} exists and holds no panel; give another directory with --out"
            )

    def _place_words(self, file: Path) -> str:
        """A file's place, for messages."""
        return f"{self.storage}/{file.relative_to(self.path).as_posix()}"

    def _is_bare(self) -> bool:
        """Whether there is nothing but what a run killed at once may have left."""
        folders = (self.evidence, self.policies, self._units)
        own = {folder.name for folder in folders} | {LOCK}
        if not self.path.is_dir() or any(any(folder.glob("*")) for folder in folders):
            return False
        names = [entry.name for entry in self.path.iterdir()]
        return all(name in own or name.startswith(f".{MANIFEST}.") for name in names)

    def _check_manifest(self, manifest: Path) -> None:
        held = read_manifest(manifest)
        before = held.get("specification", {})
        self._check_growth(before.get(GROWING), self._specification.get(GROWING))
        other = list(contradictions(before, self._specification))
        if other:
            more = [f"and {len(other) - 3} more differences"] if len(other) > 4 else []
            differences = ", ".join((other[:3] if more else other) + more)
            raise RunDirectoryError(
                f"{self.storage} holds another panel: {differences}; give another directory with "
                f"--out{self._policies_words(before)}, or the specification that it was started "
                "with"
            )
        versions = self.versions()
        changed = [
            f"{name} {was} (now {versions.get(name, 'missing')})"
            for name, was in held.get("versions", {}).items()
            if versions.get(name) != was
        ]
        if changed:
            raise RunDirectoryError(
                f"{self.storage} holds results of {', '.join(changed)}, which are never mixed with "
                "those of another version; finish it with that version, or give another directory "
                "with --out"
            )

    def _policies_words(self, before: Mapping[str, Any]) -> str:
        """How policies that are here are judged on another number of starts."""
        same = before.get("episodes") == self._specification.get("episodes")
        if same or not before.get(GROWING):
            return ""
        return f" (--policies {self.path} takes the policies from here)"

    def _check_growth(self, before: Any, now: Any) -> None:
        """Check that the seeds that were there are the first that are wanted."""
        lists = isinstance(before, list) and isinstance(now, list)
        if not lists or before == now[: len(before)]:
            return
        if not now:
            raise RunDirectoryError(
                f"{self.storage} holds a panel with policies of its own; give another directory "
                "with --out"
            )
        if now == before[: len(now)]:
            raise RunDirectoryError(
                f"{self.storage} holds this panel with {len(before)} seeds, not {len(now)}; give "
                f"--seeds {len(before)}, or another directory with --out"
            )
        raise RunDirectoryError(
            f"{self.storage} holds a panel with other seeds: {_few(before)}, now {_few(now)}; more "
            "may follow those that are there, else give another directory with --out"
        )

    def marker(self, unit: str) -> Mapping[str, Any] | None:
        """What was noted when the unit was finished, or None."""
        path = self._marker(unit)
        return _read_marker(path) if path.exists() else None

    def markers(self, prefix: str) -> dict[str, Mapping[str, Any]]:
        """Markers of the units whose names begin with ``prefix``, by name."""
        found = sorted(self._units.glob(f"{prefix}*.json"))
        return {path.stem: _read_marker(path) for path in found}

    def readable_markers(self, prefix: str) -> tuple[dict[str, Mapping[str, Any]], dict[str, str]]:
        """The markers that can be read, and what is wrong with the others, by name."""
        found: dict[str, Mapping[str, Any]] = {}
        damaged: dict[str, str] = {}
        for path in sorted(self._units.glob(f"{prefix}*.json")):
            try:
                found[path.stem] = _read_marker(path)
            except RunDirectoryError as error:
                damaged[path.stem] = str(error)
        return found, damaged

    def finished(self, unit: str, key: str, *files: Path) -> Mapping[str, Any] | None:
        """The marker of a finished unit, or None; one that has lost a file is done again, and said.

        Args:
            unit: name.
            key: of its inputs; see :func:`key_of`.
            files: what it wrote beside its records.

        Raises:
            RunDirectoryError: if the unit was finished under another key, or its records were
                changed since.
        """
        held = self.marker(unit)
        if held is not None and held.get("key") != key:
            raise RunDirectoryError(
                f"{self.storage}: unit {unit} belongs to another specification, version or policy; "
                "give another directory with --out"
            )
        if held is None:
            return None
        lost = [file for file in files if not file.exists()]
        if not self._whole_records(unit, held):
            lost.append(self._records(unit))
        if lost:
            print(
                f"{self._place_words(lost[0])} is missing or cut off: unit {unit} is done again",
                file=sys.stderr,
            )
        return None if lost else held

    def has_records(self, unit: str) -> bool:
        """Whether the unit's records are there."""
        return self._records(unit).is_file()

    def _whole_records(self, unit: str, held: Mapping[str, Any]) -> bool:
        """Whether a unit's records are those that it was finished with.

        Raises:
            RunDirectoryError: if they are whole, and others.
        """
        file, noted = self._records(unit), held.get(RECORDS)
        if not file.is_file():
            return noted is None
        if file_hash(file) == noted:
            return True
        if _is_cut_off(file):
            return False
        raise RunDirectoryError(
            f"{self._place_words(file)} was changed after unit {unit} was finished; restore it "
            "from a copy, or remove it to do the unit again"
        )

    def faults(self) -> Iterator[Finding]:
        """Files of finished units that are missing or changed, and files of no unit."""
        markers, damaged = self.readable_markers("")
        for unit, fault in damaged.items():
            yield Finding(self._marker(unit).relative_to(self.path).as_posix(), None, fault)
        for unit, held in markers.items():
            file = self._records(unit)
            name = file.relative_to(self.path).as_posix()
            if held.get(RECORDS) is not None and not file.is_file():
                yield Finding(name, None, "is missing")
            elif file.is_file() and file_hash(file) != held.get(RECORDS):
                yield Finding(name, None, "is not what its unit was finished with")
        for file in sorted(self.evidence.glob("*.parquet")):
            if file.stem not in markers and file.stem not in damaged:
                name = file.relative_to(self.path).as_posix()
                yield Finding(name, None, "belongs to no finished unit")

    def finish(
        self, unit: str, key: str, start: float, seconds: float | None = None, **facts: Any
    ) -> None:
        """Mark a unit as finished; its files must be in place.

        Args:
            unit: name.
            key: of its inputs; see :func:`key_of`.
            start: Unix time when work on it began, s.
            seconds: its share of that time, s; by default all.
            facts: what else to note.
        """
        end = time.time()
        share = end - start if seconds is None else seconds
        looks = self._looks_so_far()
        times = {"start": round(start, 3), "end": round(end, 3), "seconds": round(share, 3)}
        expected = dict.fromkeys({RECORDS} & _marker_kinds(unit).keys())
        found = {RECORDS: file_hash(self._records(unit))} if self.has_records(unit) else expected
        write_json(
            self._marker(unit), {"key": key, **times, **found, AFTER: hash_of_looks(looks), **facts}
        )

    def adopt_policy(self, other: RunDirectory, policy: str) -> None:
        """Take a policy's files from another directory, file by file, each in one step."""
        files = {file.name: file for file in (other.policies / policy).iterdir()}
        for remains in (self.policies / policy).glob("*"):
            if remains.name not in files:
                remains.unlink()
        for name, file in files.items():
            replace_file(self.policies / policy / name, file.read_bytes())

    def adopt(self, other: RunDirectory, unit: str) -> None:
        """Take a finished unit's records, and then its marker, from another directory.

        Its policy was looked at as often as this run's looks say by now.
        """
        if other.has_records(unit):
            replace_file(self._records(unit), other._records(unit).read_bytes())
        after = hash_of_looks(self.read_looks())
        write_json(
            self._marker(unit),
            {**_read_marker(other._marker(unit)), AFTER: after, ADOPTED: True},
        )

    def seconds(self, units: Iterable[str]) -> float:
        """Time that this run spent on finished units, added up, s."""
        return sum(float(marker["seconds"]) for marker in self._markers(units))

    def wall_seconds(self, units: Iterable[str]) -> float:
        """Time during which this run worked on some unit, however often it was begun, s."""
        total, reached = 0.0, -math.inf
        markers = self._markers(units)
        for start, end in sorted((float(m["start"]), float(m["end"])) for m in markers):
            total += max(0.0, end - max(start, reached))
            reached = max(reached, end)
        return total

    def _markers(self, units: Iterable[str]) -> list[Mapping[str, Any]]:
        found = [self.marker(unit) for unit in units]
        return [marker for marker in found if marker is not None and not marker.get(ADOPTED)]

    def discard_remains(self, unit: str) -> None:
        """Remove what is left of a unit that was not finished or has lost a file."""
        for file in (self._marker(unit), self._records(unit)):
            file.unlink(missing_ok=True)

    def discard_unmarked(self, prefix: str) -> None:
        """Remove the records of all units without a marker whose names begin with ``prefix``."""
        for path in self.evidence.glob(f"{prefix}*.parquet"):
            if not self._marker(path.stem).exists():
                path.unlink()

    def _marker(self, unit: str) -> Path:
        return self._units / f"{unit}.json"

    def _records(self, unit: str) -> Path:
        return self.evidence / f"{unit}.parquet"


def _few(values: Sequence[Any]) -> str:
    return f"{values[0]} to {values[-1]}" if values else "none"


def first_of(marker: Mapping[str, Any]) -> int:
    """First episode of a unit that evaluates or tries."""
    return int(marker[FIRST])


def name_start(episode: int) -> str:
    """End of the name of a unit whose episodes begin with one; nothing for those from the start."""
    return f"-from-{episode}" if episode else ""


def key_of(engines: Mapping[str, str], **parts: Any) -> str:
    """Hash of a unit's inputs and of the versions of the packages and of foreign engines."""
    text = json.dumps({"versions": {**package_versions(), **engines}, **parts}, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def hash_of_looks(looks: Sequence[Any]) -> str:
    """What a marker keeps of the looks at verdicts before it."""
    return hashlib.sha256(json.dumps(looks, sort_keys=True).encode()).hexdigest()[:16]


def read_manifest(path: Path) -> dict[str, Any]:
    """What a directory says of its run.

    Raises:
        RunDirectoryError: if it is damaged.
    """
    remedy = "restore it from a copy, or give another directory with --out"
    held = _read(path, _OF_MANIFEST, _MAY_SAY, remedy)
    try:
        _looks_in(held)
    except msgspec.ValidationError as error:
        if all(type(count) is int for count in held[_LOOKS]):
            raise RunDirectoryError(
                f"{path} keeps its looks in the format of an earlier version; go on with the "
                "version that wrote it, or give another directory with --out"
            ) from None
        raise RunDirectoryError(f"{path} is damaged at {_LOOKS!r}: {error}; {remedy}") from None
    return held


def _looks_in(manifest: Mapping[str, Any]) -> list[Seen]:
    return msgspec.convert(manifest.get(_LOOKS, []), list[Seen])


def _is_cut_off(file: Path) -> bool:
    """Whether a Parquet file lacks its end."""
    with file.open("rb") as content:
        content.seek(max(0, file.stat().st_size - 4))
        return content.read() != b"PAR1"


def _read_marker(path: Path) -> dict[str, Any]:
    """What was noted of a finished unit, with all that units of its kind note."""
    remedy = "remove it to do the unit again"
    held = _read(path, _marker_kinds(path.stem), _MAY_NOTE, remedy)
    if not all(isinstance(x, str) for x in held.get("policies", {}).values()):
        raise RunDirectoryError(f"{path} is damaged: 'policies' must hold hashes; {remedy}")
    for names in held.get("cells", {}).values():
        listed = names if isinstance(names, list) else [None]
        if not all(isinstance(name, str) for name in listed) or len({*listed}) < len(listed):
            raise RunDirectoryError(
                f"{path} is damaged: 'cells' must hold lists of names, each once; {remedy}"
            )
    return held


def _marker_kinds(unit: str) -> Kinds:
    """What the marker of a unit holds, by the first word of its name."""
    return {**_NOTED, **_NOTED_BY.get(unit.partition("-")[0], {})}


def _read(path: Path, kinds: Kinds, others: Sequence[str], remedy: str) -> dict[str, Any]:
    """A file with some keys, and perhaps some others, but none besides."""
    try:
        held = read_object(path, kinds, remedy)
    except ValueError as error:
        raise RunDirectoryError(str(error)) from None
    for name in sorted(held.keys() - {*kinds, *others}):
        raise RunDirectoryError(f"{path} is damaged: {name!r} means nothing there; {remedy}")
    return held
