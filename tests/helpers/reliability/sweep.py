"""A sweep over every leaf of a finished run: what `verify` has to say when one is changed.

``python tests/helpers/reliability/sweep.py --every`` changes all leaves in all ways, which takes
hours, and prints those of which `verify` says nothing.
"""

from __future__ import annotations

import argparse
import json
import random
import re
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from fnmatch import fnmatchcase
from pathlib import Path
from typing import TypeVar

from forgery import make_fit
from leaves import (
    Leaf,
    change_json,
    change_records,
    change_schema,
    change_zip,
    json_leaves,
    record_leaves,
    schema_leaves,
    zip_leaves,
)
from victim import Task

from integ_gym.eval.panel.checking.page import against_plan
from integ_gym.eval.panel.existing.run_policies import acting_in
from integ_gym.eval.panel.model.files import FILE_NAME, read_panel, write_panel
from integ_gym.eval.panel.model.panel import Panel
from integ_gym.eval.panel.results.comparing import differences
from integ_gym.eval.panel.results.outputs import noted_call, panel_of
from integ_gym.eval.panel.running.run_directory import RunDirectory
from integ_gym.eval.panel.specification.planned import planned_spec
from integ_gym.evidence.schema.errors import Finding
from integ_gym.evidence.store.store import EvidenceStore
from integ_gym.evidence.verification.gaps import missing_episodes, other_columns
from integ_gym.evidence.verification.recomputing import recompute
from integ_gym.evidence.verification.sampling import replay_some
from integ_gym.evidence.verification.sealing import broken_seals, seal

T = TypeVar("T")

SECURITY = Path(__file__).parents[3] / "SECURITY.md"

SPEC = """
name = "sweep"
question = "Does it carry over?"
env_id = "IntegPendulum-v0"
control_period = 0.05
seeds = [0, 1]
episodes = 2
trace_every = 2
trainer = "sb3"
baselines = ["zero", "handmade"]
family = [["rk4 dt=0.05", "reference dt=0.05"]]
ladder = false

[environment]
start = "hanging"
max_torque = 1.0
duration = 0.5
observation_noise = 0.01
action_latency = 0.05

[training]
total_steps = 128
n_envs = 2
n_steps = 32
batch_size = 32
n_epochs = 1
net_arch = [4]
trace_every = 3

[[train]]
integrator = "rk4"
dt = 0.05

[[evaluate]]
integrator = "rk4"
dt = [0.05, 0.0125]

[[perturbations]]
name = "heavy"
environment = { mass = 1.2 }
"""
"""Of a run with all kinds of files and records."""


_DEEP = ("records of training, untraced", "records of evaluation, traced")
"""Records whose columns of JSON are gone through leaf by leaf, unless all are asked for."""


def make_run(folder: Path) -> Path:
    """Make the run whose leaves are changed, without its pictures."""
    spec = folder / "sweep.toml"
    spec.write_text(SPEC, encoding="utf-8")
    code, told = Task(("panel", str(spec)), folder / "run").run(folder / "run")
    assert code == 0, told
    shutil.rmtree(folder / "run" / "figures")
    (folder / "run" / "report.html").unlink()
    return folder / "run"


def leaves_of(run: Path, every: bool = False) -> list[Leaf]:
    """The leaves of a run: one change of each kind of leaf, or all changes of all."""
    panel = json.loads((run / "panel.json").read_text(encoding="utf-8"))
    policies = [policy["id"] for row in panel["rows"] for policy in row["policies"]]
    names = [*policies, *(one["name"] for part in ("rows", "cells") for one in panel[part])]
    found = [
        *json_leaves(run, names, every),
        *zip_leaves(run),
        *schema_leaves(run),
        *record_leaves(run, every),
    ]
    if every:
        return found
    first: dict[tuple[str, str], Leaf] = {}
    for leaf in found:
        if ":" not in leaf.place or not leaf.file.startswith("records of ") or leaf.file in _DEEP:
            first.setdefault(leaf.kind, leaf)
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
        inside = (own, f"{own}.*", f"{own}(*")
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

    def silent(self, leaves: Sequence[Leaf]) -> list[Leaf]:
        """Leaves that can be changed, each alone, without a word of `verify`."""
        records = [leaf for leaf in leaves if leaf.file.startswith("records of ")]
        others = [leaf for leaf in leaves if not leaf.file.startswith("records of ")]
        found = [leaf for leaf in others if self.first_finding([leaf]) is None]
        groups: list[list[Leaf]] = []
        for leaf in records:  # one change of a record at a time
            place = (leaf.path, leaf.keys[0])
            free = (g for g in groups if all((x.path, x.keys[0]) != place for x in g))
            group = next(free, None)
            if group is None:
                groups.append([leaf])
            else:
                group.append(leaf)
        for group in groups:
            found += self._silent_records(group)
        return found

    def _silent_records(self, leaves: Sequence[Leaf]) -> list[Leaf]:
        """Those of leaves of different records; what is named is left out, the rest halved."""
        if not leaves:
            return []
        rows = self._change(leaves)
        findings = list(self._findings(self.run))
        self._restore()
        if not findings:
            return list(leaves)
        if len(leaves) == 1:
            return []
        named = [leaf for leaf in leaves if any(_names(x, leaf, rows[leaf]) for x in findings)]
        rest = [leaf for leaf in leaves if leaf not in named]
        if named:
            return self._silent_records(rest)
        middle = len(rest) // 2
        return self._silent_records(rest[:middle]) + self._silent_records(rest[middle:])

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
        if {leaf.file for leaf in leaves} != {FILE_NAME}:
            return next((str(x) for x in self._findings(run)), None)
        try:
            found = differences(read_panel(run / FILE_NAME), self.panel)
            return next((str(x) for x in found), None)
        except ValueError as error:
            return str(error)

    def _change(self, leaves: Sequence[Leaf]) -> dict[Leaf, dict[str, object]]:
        """Change leaves, and make hashes, markers, page and seal fit.

        The page is made anew of changed records and markers, and not of a changed plan.
        """
        rows = change_records(self.run, [x for x in leaves if x.file.startswith("records of ")])
        others = [leaf for leaf in leaves if leaf not in rows and leaf.file != FILE_NAME]
        for leaf in sorted(others, key=lambda leaf: -len(leaf.keys)):  # what is within, first
            if leaf.file.endswith(".zip"):
                change_zip(self.run, leaf)
            elif leaf.file.startswith("schema of "):
                change_schema(self.run, leaf)
            else:
                self._change_json(leaf)
        with suppress(AttributeError, KeyError, TypeError):  # of what has lost its form
            make_fit(self.run, panel=False)
        if rows or any(leaf.file.startswith("units/") for leaf in others):
            with suppress(Exception):  # records of which no page can be made
                write_panel(made(self.run), self.run)
        for leaf in leaves:
            if leaf.file == FILE_NAME:
                self._change_json(leaf)
        seal(self.run)
        return rows

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
            lambda: broken_seals(run),
            lambda: against_plan(run, all_searches=True),
            lambda: iter(store.verify()),
            lambda: missing_episodes(store),
            lambda: other_columns(store),
            lambda: (x for file, one in store.named_records() for x in recompute(one, file)),
            lambda: iter(replay_some(store, None, random.Random(0), acting_in(store)).findings),
        )
        for check in checks:
            try:
                yield from check()
            except ValueError as error:  # which `verify` prints as a finding
                yield str(error)


def told_otherwise(sweep: Sweep, leaves: Sequence[Leaf]) -> list[str]:
    """Places of ``panel.json`` that come out otherwise when leaves are changed together."""
    return sweep.with_changed(
        leaves, lambda run: [x for x, *_ in differences(made(run), sweep.panel)]
    )


def made(run: Path) -> Panel:
    """What ``panel.json`` has to say of plan and records as they are."""
    directory = RunDirectory(run, {})
    spec = planned_spec(directory.manifest()["specification"])
    return panel_of(spec, directory, noted_call(directory))


def _names(finding: Finding | str, leaf: Leaf, row: dict[str, object]) -> bool:
    """Whether a finding is about the record, or the column of its kind, that was changed."""
    told = str(finding)
    column = leaf.keys[1]
    return str(row["record_id"]) in told or (
        f"`{column}" in told and str(row["policy_id"]) in told and str(row["cell"]) in told
    )


def main() -> int:
    """Change all leaves and print those that nobody notices: 1 if one is not on the list."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--every", action="store_true", help="all leaves in all ways")
    parser.add_argument("--only", default="*", help="pattern of kinds of files")
    given = parser.parse_args()
    patterns, left = listed(SECURITY.read_text(encoding="utf-8")), 0
    with tempfile.TemporaryDirectory() as folder:
        run = make_run(Path(folder))
        sweep = Sweep(run, Path(folder) / "work")
        leaves = [x for x in leaves_of(run, given.every) if fnmatchcase(x.file, given.only)]
        for leaf in sweep.silent(leaves):
            left += not is_listed(leaf, patterns)
            print(leaf, "" if is_listed(leaf, patterns) else "NOT LISTED", flush=True)
    print(f"{len(leaves)} leaves were changed, {left} are silent and not listed")
    return 1 if left else 0


if __name__ == "__main__":
    sys.exit(main())
