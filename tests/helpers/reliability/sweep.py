"""A sweep over every leaf of finished runs: what `verify` has to say when one is changed.

``python tests/helpers/reliability/sweep.py --every`` changes all leaves in all ways, each alone,
and prints those of which `verify` says nothing. Leaves of which SECURITY.md says that nothing
proves them are changed together, and by halves where something is said.
"""

from __future__ import annotations

import argparse
import json
import math
import multiprocessing
import random
import re
import shutil
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import suppress
from fnmatch import fnmatchcase
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import pyarrow as pa
import pyarrow.parquet as pq
from forgery import make_fit
from leaves import (
    GIVEN,
    Leaf,
    change_json,
    change_records,
    change_schema,
    change_zip,
    json_leaves,
    record_leaves,
    row_after,
    schema_leaves,
    zip_leaves,
)
from msgspec import to_builtins
from victim import PICTURES, Task, write_spec

from integ_gym.eval.panel.artefact import differences
from integ_gym.eval.panel.checking.page import against_plan
from integ_gym.eval.panel.existing import build_given_panel
from integ_gym.eval.panel.outputs import panel_of, read_call
from integ_gym.eval.panel.plan import read_planned_spec
from integ_gym.eval.panel.policies import ActingIn
from integ_gym.eval.panel.result import FILE_NAME, Panel, read_panel, write_panel
from integ_gym.eval.panel.run_directory import MANIFEST, RunDirectory
from integ_gym.evidence.fields import PHASES
from integ_gym.evidence.recomputing import recompute
from integ_gym.evidence.record import EvidenceRecord, records_of
from integ_gym.evidence.replaying import missing_episodes, other_columns, replay, replay_some
from integ_gym.evidence.schema import Finding
from integ_gym.evidence.sealing import find_broken_seals, seal
from integ_gym.evidence.store import EvidenceStore
from integ_gym.support.processes import cores

T = TypeVar("T")

SECURITY = Path(__file__).parents[3] / "SECURITY.md"

RECORDS = "records of "
"""How the kinds of records begin, where kinds of files begin otherwise."""

KINDS = (
    *("panel.json", "run.json", "policies/*/policy.json", "policies/*/policy.zip"),
    *("units/achieve-*.json", "units/evaluate-*.json", "units/train-*.json"),
    "schema of evidence/*.parquet",
    *(f"{RECORDS}{phase}, {trace}" for phase in PHASES for trace in ("traced", "untraced")),
)
"""All kinds of files and records that a run has."""

_FLEET = f"{RECORDS}fleet training, "

WHOLE = {
    "grown": (MANIFEST, f"{_FLEET}traced", f"{_FLEET}untraced"),
    "evaluated": (MANIFEST, f"{RECORDS}evaluation, traced", GIVEN),
    "published": (MANIFEST, FILE_NAME, "units/contract-*.json"),
    "checked": (MANIFEST, FILE_NAME),
}
"""The other runs, and their kinds whose leaves are all changed, for their plan is of another form.

Of other kinds those leaves are changed that the first run does not have.
"""


def make_runs(folder: Path) -> None:
    """Make the runs whose leaves are changed, without pictures, each in a folder of its name.

    The first has all kinds of files and records. Of the others one is of the fleet, on a mixture,
    with a seed more than it began with; one evaluates a policy of the first, and one its zip alone,
    on another engine too; one checks what a discretization costs.
    """
    first = write_spec(
        folder / "first.toml",
        name="sweep",
        top="""
question = "Does it carry over?"
episodes = 2
trainer = "sb3"
baselines = ["zero", "handmade"]
family = [["rk4 dt=0.05", "reference dt=0.05"]]
ladder = false
""",
        environment="duration = 0.5\nobservation_noise = 0.01\naction_latency = 0.05\n"
        'fallback = "zero"',
        evaluate="""
integrator = "rk4"
dt = [0.05, 0.0125]

[[perturbations]]
name = "heavy"
environment = { mass = 1.2 }
""",
    )
    grown = write_spec(
        folder / "grown.toml",
        name="sweep",
        top='episodes = 2\ntrainer = "fleet"\nbaselines = ["zero"]\nladder = false\n'
        "perturbations = []",
        environment="duration = 0.5",
        train="""
mixture = "two"
members = [
  { integrator = "rk4", dt = 0.05 },
  { integrator = "symplectic_euler", dt = 0.05 },
]
""",
        evaluate='integrator = ["rk4", "symplectic_euler"]\ndt = 0.05',
    )
    policy = folder / "first/policies/rk4-dt-0.05-seed0/policy.zip"
    bare = folder / "published.zip"
    cells = "--env=IntegPendulum-v0 --integrator=rk4 --dt=0.05 --episodes=2"
    home = "--home=integrator=rk4,dt=0.05,control_period=0.05 --env-arg=duration=0.5"
    engines = "--engine=native --engine=mujoco --integrator=RK4"
    small = "--train-arg=total_steps=128 --train-arg=n_steps=32 --train-arg=batch_size=32"
    checked = "--integrator=rk4 --dt=0.05 --env-arg=duration=0.5 --seeds=2 --trainer=sb3"
    for name, words in (
        ("first", f"panel {first}"),
        *(("grown", f"panel {grown} --seeds={count}") for count in (1, 2)),
        ("evaluated", f"evaluate {policy} {cells}"),
        ("published", f"evaluate {bare} {cells} {home} {engines}"),
        ("checked", f"check {checked} {small}"),
    ):
        if name == "published":
            shutil.copy(policy, bare)
        code, told = Task(tuple(words.split()), folder / name).run(folder / name)
        assert code == 0, told
    for run in ("first", *WHOLE):
        for name in PICTURES:
            path = folder / run / name
            shutil.rmtree(path) if path.is_dir() else path.unlink()


def leaves_of(run: Path, every: bool = False) -> list[Leaf]:
    """The leaves of a run: one change of each kind of leaf of its files, and those of its form, and
    all of its records.

    Args:
        run: the run.
        every: all changes of all leaves of its files, and more of its records.
    """
    panel = json.loads((run / FILE_NAME).read_text(encoding="utf-8"))
    policies = [policy["id"] for row in panel["rows"] for policy in row["policies"]]
    names = [*policies, *(one["name"] for part in ("rows", "cells") for one in panel[part])]
    files = [*json_leaves(run, names, every), *zip_leaves(run), *schema_leaves(run)]
    return [*(files if every else first_of_kind(files, _OF_FORM)), *record_leaves(run, every)]


def others_of(run: Path, known: Sequence[Leaf], every: bool = False) -> list[Leaf]:
    """The leaves of one of the other runs that are of another kind than all those that are known.

    Args:
        run: the run.
        known: leaves of the first run.
        every: see :func:`leaves_of`.
    """
    kinds = {leaf.kind for leaf in known}
    whole = WHOLE[run.name]
    return [x for x in leaves_of(run, every) if x.file in whole or x.kind not in kinds]


_OF_FORM = ("gone", "key added", "entry twice")
"""Changes after which what is read may be what it was."""


def first_of_kind(leaves: Sequence[Leaf], apart: Sequence[str] = ()) -> list[Leaf]:
    """One leaf of each kind, and one of each with a change that is looked at apart."""
    first: dict[tuple[str, ...], Leaf] = {}
    for leaf in leaves:
        first.setdefault((*leaf.kind, leaf.change if leaf.change in apart else ""), leaf)
    return list(first.values())


def listed(text: str) -> list[tuple[str, str]]:
    """Kinds of files and of leaves that a document says nothing proves, as patterns.

    Rows of the table under the heading "Not proven": files in the first column, leaves in the
    second.
    """
    section = text.split("### Not proven", 1)[1].split("\n#", 1)[0]
    found = []
    for line in section.splitlines():
        if line.startswith("| `"):
            files, places, *_ = line.strip("|").split("|")
            codes = [re.findall(r"`([^`]+)`", part) for part in (files, places)]
            found += [(file, place) for file in codes[0] for place in codes[1]]
    return found


def is_listed(leaf: Leaf, patterns: Sequence[tuple[str, str]]) -> bool:
    """Whether a document says that nothing proves a leaf, or what holds it."""
    place = leaf.place.replace("[", "(").replace("]", ")")
    for file, listed_place in patterns:
        own = listed_place.replace("[", "(").replace("]", ")")
        inside = (own, f"{own}.*", f"{own}:*", f"{own}(*")
        if fnmatchcase(leaf.file, file) and any(fnmatchcase(place, one) for one in inside):
            return True
    return False


class Sweep:
    """A run that is changed and put back, again and again.

    Args:
        run: as it was finished.
        work: folder that does not exist, for a copy.
    """

    def __init__(self, run: Path, work: Path) -> None:
        self.run = shutil.copytree(run, work)
        self.panel = read_panel(self.run / FILE_NAME)
        self._files = {file: file.read_bytes() for file in work.rglob("*") if file.is_file()}
        self._tables = {
            file.relative_to(work).as_posix(): pq.read_table(file)
            for file in sorted(work.glob("evidence/*.parquet"))
        }
        self._acting = ActingIn(EvidenceStore(work / "evidence"))
        self._rows = {path: table.to_pylist() for path, table in self._tables.items()}

    def silent(self, leaves: Sequence[Leaf], every: bool = False) -> list[Leaf]:
        """Leaves that can be changed, each alone, without a word of `verify`.

        Args:
            leaves: of the run.
            every: all changes of a leaf of records, or one of those that the record alone does not
                tell.
        """
        records = self.unrefuted([leaf for leaf in leaves if _is_record(leaf)])
        if not every:
            records = first_of_kind(records)
        records = [leaf for leaf in records if not self._is_denied_by_replay(leaf)]
        left = [leaf for leaf in leaves if not _is_record(leaf)]
        left += [leaf for leaf in records if leaf.keys[1] in _TOUCHING]
        for group in self._groups([x for x in records if x.keys[1] not in _TOUCHING]):
            left += self._unnamed(group)
        return [leaf for leaf in left if self.first_finding([leaf]) is None]

    def silent_together(self, leaves: Sequence[Leaf]) -> list[Leaf]:
        """Leaves of which `verify` says nothing when those of a kind of file are changed at once.

        Where it says something, they are halved until it says nothing or one leaf is left.
        """
        records = self.unrefuted([leaf for leaf in leaves if _is_record(leaf)])
        groups: dict[tuple[str, str], list[Leaf]] = {}
        for leaf in (*records, *(leaf for leaf in leaves if not _is_record(leaf))):
            groups.setdefault((leaf.file, leaf.change), []).append(leaf)
        found, left = [], [sorted(group, key=lambda leaf: leaf.place) for group in groups.values()]
        while left:
            group = left.pop()
            if self.first_finding(group) is None:
                found += group
            elif len(group) > 1:
                left += [group[: len(group) // 2], group[len(group) // 2 :]]
        return found

    def unrefuted(self, leaves: Sequence[Leaf]) -> list[Leaf]:
        """Those of leaves of records whose record, recomputed alone, tells nothing."""
        left = []
        for path in self._tables:
            own = [leaf for leaf in leaves if leaf.path == path]
            rows = [self._row_after(leaf) for leaf in own]
            for leaf, record in zip(own, self._records(path, rows), strict=True):
                if next(recompute(record, path), None) is None:
                    left.append(leaf)
        return left

    def _is_denied_by_replay(self, leaf: Leaf) -> bool:
        """Whether the episode, played again with those that its policy decides with, is another.

        Who plays all again finds that too, and may find more: here nothing is known of how exact
        the rest comes out.
        """
        row = self._row(leaf)
        own = [x for x in self._rows[leaf.path] if _cell_of(x) == _cell_of(row)]
        decided = bool(row["policy_hash"]) and any(x["reward"] is None for x in own)
        rows = [self._row_after(leaf)]
        if decided:
            rows += [x for x in own if x["record_id"] != row["record_id"]]
        records = [(leaf.path, record) for record in self._records(leaf.path, rows)]
        return bool(replay(records, policy=self._acting if decided else None).findings)

    def _records(self, path: str, rows: Sequence[dict[str, Any]]) -> list[EvidenceRecord]:
        return records_of(pa.Table.from_pylist(list(rows), self._tables[path].schema))

    def _row_after(self, leaf: Leaf) -> dict[str, Any]:
        return row_after(self._rows[leaf.path], self._tables[leaf.path].schema, leaf)

    def _groups(self, leaves: Sequence[Leaf]) -> list[list[Leaf]]:
        """Leaves of records that can be changed together: what is said of one is of no other."""
        groups: list[tuple[list[Leaf], set[Any]]] = []
        for leaf in leaves:
            row, column = self._row(leaf), leaf.keys[1]
            where = leaf.place if column == _VERSIONS else _cell_of(row)
            marks = {row["record_id"], (column, where)}
            judged = row["phase"] == "evaluation"  # what other records must say follows from these
            free = (one for one in groups if (judged in one[1]) and not one[1] & marks)
            group = next(free, None)
            if group is None:
                group = ([], {judged})
                groups.append(group)
            group[0].append(leaf)
            group[1].update(marks)
        return [group for group, _ in groups]

    def _unnamed(self, leaves: Sequence[Leaf]) -> list[Leaf]:
        """Those of a group's leaves of which nothing is said when all are changed together."""
        told = self.with_changed(
            leaves, lambda run: list(map(str, against_plan(run, all_searches=True)))
        )
        return [leaf for leaf in leaves if not any(self._names(one, leaf) for one in told)]

    def _names(self, told: str, leaf: Leaf) -> bool:
        """Whether a finding is about the column, and the record or those alike, of a leaf."""
        row, column = self._row(leaf), leaf.keys[1]
        if column == _VERSIONS:
            return f"`{leaf.place.replace(':', '.')}`" in told
        if row["record_id"] in told:
            return "`" not in told or any(f"`{x}" in told for x in (column, "plain"))
        if f"policy {row['policy_id']!r}" not in told:
            return False
        if f"training episode {row['episode_index']} of" in told:
            return column in ("seed", "rng_key")
        where = row["phase"] == "training" or repr(row["cell"]) in told
        return where and any(f"`{name}" in told for name in (column, *_ALIAS.get(column, ())))

    def _row(self, leaf: Leaf) -> dict[str, Any]:
        return self._rows[leaf.path][leaf.keys[0]]

    def first_finding(self, leaves: Sequence[Leaf]) -> str | None:
        """What is said first when leaves are changed together; None if nothing is.

        A page is held against itself as it was, which is what `verify` makes of plan and records.
        """
        return self.with_changed(leaves, lambda run: self._first_finding(run, leaves))

    def with_changed(self, leaves: Sequence[Leaf], ask: Callable[[Path], T]) -> T:
        """What is answered of the run while leaves are changed."""
        self._change(leaves)
        try:
            return ask(self.run)
        finally:
            self._restore()

    def _first_finding(self, run: Path, leaves: Sequence[Leaf]) -> str | None:
        files = {leaf.file for leaf in leaves}
        if files <= {FILE_NAME, MANIFEST}:
            try:  # what `verify` compares as well, and takes less time
                read_panel(run / FILE_NAME)
                said = json.loads((run / FILE_NAME).read_text(encoding="utf-8"))
                made = self.panel if files == {FILE_NAME} else remade(run)
                told = next((str(x) for x in differences(said, made)), None)
            except ValueError as error:
                told = str(error) if files == {FILE_NAME} else None
            except (AssertionError, AttributeError, LookupError, TypeError):  # without its form
                told = None
            if told is not None or files == {FILE_NAME}:
                return told
        return next((str(x) for x in self._findings(run)), None)

    def _change(self, leaves: Sequence[Leaf]) -> None:
        """Change leaves, and make hashes, markers, page and seal fit.

        The page is made anew of changed records and markers, and not of a changed plan.
        """
        records = [leaf for leaf in leaves if _is_record(leaf)]
        change_records(self.run, sorted(records, key=lambda leaf: -len(leaf.keys)))
        others = [leaf for leaf in leaves if not _is_record(leaf) and leaf.file != FILE_NAME]
        for leaf in sorted(others, key=lambda leaf: -len(leaf.keys)):  # what is within, first
            if leaf.file.endswith(".zip"):
                change_zip(self.run, leaf)
            elif leaf.file.startswith("schema of "):
                change_schema(self.run, leaf)
            else:
                self._change_json(leaf)
        with suppress(AttributeError, KeyError, TypeError):  # of what has lost its form
            make_fit(self.run, panel=False)
        if records or any(leaf.file.startswith("units/") for leaf in others):
            with suppress(Exception):  # records of which no page can be made
                write_panel(remade(self.run), self.run)
        for leaf in leaves:
            if leaf.file == FILE_NAME:
                self._change_json(leaf)
        seal(self.run)

    def _change_json(self, leaf: Leaf) -> None:
        file = self.run / leaf.path
        held = json.loads(file.read_text(encoding="utf-8"))
        change_json(held, leaf.keys, leaf.change)
        file.write_text(json.dumps(held), encoding="utf-8")

    def _restore(self) -> None:
        for file, content in self._files.items():
            if not file.is_file() or file.read_bytes() != content:
                file.write_bytes(content)

    def _findings(self, run: Path) -> Iterator[Finding | str]:
        """What `evidence verify --all` looks at, the quickest first; an exception is let out."""
        store = EvidenceStore(run / "evidence")
        checks: tuple[Callable[[], Iterator[Finding]], ...] = (
            lambda: find_broken_seals(run),
            lambda: other_columns(store),
            lambda: against_plan(run, all_searches=True),
            lambda: iter(store.verify()),
            lambda: missing_episodes(store),
            lambda: (x for file, one in store.named_records() for x in recompute(one, file)),
            lambda: iter(replay_some(store, None, random.Random(0), ActingIn(store)).findings),
        )
        for check in checks:
            try:
                yield from check()
            except ValueError as error:  # which `verify` prints as a finding
                yield str(error)


_VERSIONS = "package_versions"
"""Column of which findings name neither record nor policy."""

_TOUCHING = ("success", "run_id", "env_id", "schema_version")
"""Columns from which follows what other records, or the whole file, must say."""

_ALIAS = {"seed": ("first_seed",), "rng_key": ("first_of_seed",), "trace_every": ("traceless",)}
"""Under what other names findings tell of a column."""


def _cell_of(row: Mapping[str, Any]) -> tuple[Any, ...]:
    """What the records of a policy in a cell have in common."""
    return row["phase"], row["policy_id"], row["cell"]


def _is_record(leaf: Leaf) -> bool:
    return leaf.file.startswith(RECORDS)


def changed_places(sweep: Sweep, leaves: Sequence[Leaf]) -> list[str]:
    """Places of ``panel.json`` that come out otherwise when leaves are changed together."""
    return sweep.with_changed(
        leaves, lambda run: [x for x, *_ in differences(to_builtins(remade(run)), sweep.panel)]
    )


def remade(run: Path) -> Panel:
    """What ``panel.json`` has to say of plan and records as they are."""
    directory = RunDirectory(run, {})
    plan = directory.manifest()["specification"]
    spec, called = read_planned_spec(plan), read_call(directory)
    return (build_given_panel if "policy" in plan else panel_of)(spec, directory, called)


def silent_of(run: Path, leaves: Sequence[Leaf], every: bool) -> tuple[list[Leaf], float]:
    """Leaves that stay silent, those that are listed last; processor time that it took, s."""
    began, patterns = time.process_time(), listed(SECURITY.read_text(encoding="utf-8"))
    known = [leaf for leaf in leaves if is_listed(leaf, patterns)]
    with tempfile.TemporaryDirectory() as folder:
        sweep = Sweep(run, Path(folder) / "run")
        found = sweep.silent([leaf for leaf in leaves if leaf not in set(known)], every)
        found += sweep.silent_together(known)
    return found, time.process_time() - began


def parts_of(leaves: Sequence[Leaf], workers: int) -> list[list[Leaf]]:
    """Leaves in parts for processes; those of records, which are changed in groups, in few."""
    kinds: dict[str, list[Leaf]] = {}
    for leaf in leaves:
        kinds.setdefault(RECORDS if _is_record(leaf) else leaf.file, []).append(leaf)
    parts = []
    for kind, own in kinds.items():
        count = 2 * workers if kind == RECORDS else math.ceil(len(own) / 150)
        parts += [own[k::count] for k in range(count)]
    return sorted(filter(None, parts), key=lambda part: -len(part))


def _tell(what: str, job: Future[tuple[list[Leaf], float]]) -> None:
    """Say that a part is done, for who waits."""
    if job.exception() is None:
        found, seconds = job.result()
        print(f"{what}: {len(found)} silent, {seconds:.0f} s", file=sys.stderr, flush=True)


def main() -> int:
    """Change all leaves and print those that nobody notices: 1 if one is not on the list."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--every", action="store_true", help="all leaves in all ways")
    parser.add_argument("--only", default="*", help="pattern of kinds of files")
    parser.add_argument("--runs", type=Path, help="folder of the runs, made if it is not there")
    parser.add_argument("--workers", type=int, default=cores(), help="processes (all cores)")
    given = parser.parse_args()
    patterns, wrong = listed(SECURITY.read_text(encoding="utf-8")), 0
    with (
        tempfile.TemporaryDirectory() as folder,
        ProcessPoolExecutor(given.workers, multiprocessing.get_context("spawn")) as pool,
    ):
        runs = given.runs or Path(folder) / "runs"
        if not runs.exists():
            runs.mkdir(parents=True)
            make_runs(runs)
        first, asked = leaves_of(runs / "first", given.every), {}
        for name in ("first", *WHOLE):
            found = first if name == "first" else others_of(runs / name, first, given.every)
            leaves = [leaf for leaf in found if fnmatchcase(leaf.file, given.only)]
            parts = parts_of(leaves, given.workers)
            jobs = [pool.submit(silent_of, runs / name, part, given.every) for part in parts]
            asked[name] = leaves, jobs
            for part, job in zip(parts, jobs, strict=True):
                job.add_done_callback(partial(_tell, f"{name}: {len(part)} of {part[0].file}"))
        for name, kinds in {"first": KINDS, **WHOLE}.items():
            leaves, parts = asked[name]
            done = [part.result() for part in parts]
            silent = [leaf for found, _ in done for leaf in found]
            for leaf in silent:
                if not is_listed(leaf, patterns):
                    wrong += 1
                    print(f"{name}: {leaf}: SILENT, NOT LISTED")
            counts = Counter(leaf.file for leaf in leaves)
            for kind in (one for one in kinds if not counts[one] and fnmatchcase(one, given.only)):
                wrong += 1
                print(f"{name}: {kind}: NO LEAVES")
            for kind, count in counts.items():
                own = Counter(leaf.place for leaf in silent if leaf.file == kind)
                told = ", ".join(f"{place} {n}" for place, n in sorted(own.items()))
                print(f"{name}: {kind}: {count} changed, {own.total()} silent{told and ': '}{told}")
            seconds = sum(took for _, took in done)
            print(f"{name}: {seconds:.0f} s of one core", flush=True)
    print(f"{wrong} are silent and not listed, or kinds without leaves")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
