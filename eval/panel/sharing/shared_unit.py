"""A unit of work as a small value, and how it is done wherever that may be."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal

from integ_gym.support.sharing.claims import Claim
from integ_gym.support.storing.storage import Storage

from ..running.evaluation.achievability import try_and_note, unit_of_cell
from ..running.evaluation.subjects import Subject
from ..running.evaluation.units import evaluate_batch, statuses
from ..running.panel import subject_of
from ..running.run_directory import MANIFEST, RunDirectory, read_manifest
from ..running.staging import Desk
from ..running.training import train_chunk_here
from ..running.units import is_there, units_of
from ..specification.panel_spec import PanelSpec
from ..specification.planned import planned_spec

Kind = Literal["train", "try", "evaluate"]


@dataclass(frozen=True)
class SharedUnit:
    """What is to be done, by names alone; the rest is in the run's directory.

    Attributes:
        kind: of work.
        name: of the unit.
        policies: that are trained together, or evaluated together.
        recorded: cells of these policies that there are records of.
        cell: that is tried.
        first: the first of the episodes that it is done from, which are those that came at a time.
        at_home: policies' earlier episodes at home: policy, cell, of how many of how many it
            succeeded.
    """

    kind: Kind
    name: str
    policies: tuple[str, ...] = ()
    recorded: tuple[str, ...] = ()
    cell: str = ""
    first: int = 0
    at_home: tuple[tuple[str, str, int, int], ...] = ()

    @classmethod
    def of(cls, plain: Mapping[str, Any]) -> SharedUnit:
        """From plain data, as :func:`dataclasses.asdict` gives it and JSON keeps it."""
        lists = {name: tuple(plain[name]) for name in ("policies", "recorded")}
        at_home = tuple(tuple(told) for told in plain["at_home"])
        return cls(**{**plain, **lists, "at_home": at_home})

    def plain(self) -> dict[str, Any]:
        """As plain data."""
        return asdict(self)


def do_and_commit(
    desk: Desk, claim: Claim, unit: SharedUnit, subjects: Sequence[Subject] | None = None
) -> bool:
    """Do a unit that is held, and put its results in place; False if it was taken over.

    Args:
        desk: where it was claimed.
        claim: on it.
        unit: the unit.
        subjects: the policies that are evaluated, where the run's own are not.
    """
    if not claim.decided:
        _do(desk.run, desk.staged(claim), unit, subjects)
    return commit(desk, claim)


def commit(desk: Desk, claim: Claim) -> bool:
    """Put what waits in place, if it is decided that it counts; False if it was taken over."""
    if not claim.decided:
        desk.hand_in(claim)
    if not claim.commit():
        desk.discard(claim)
        return False
    desk.put_in_place(claim)
    claim.finish()
    return True


def _do(run: Storage, staged: Path, unit: SharedUnit, subjects: Sequence[Subject] | None) -> None:
    """Do a unit, and write its results into a folder."""
    spec, directory = _opened(run)
    run.fetch(*_inputs(spec, run, unit))
    there = RunDirectory(staged, spec.to_json(), spec.engine_versions())
    there.looks_before = directory.noted_looks()
    there.make_folders()
    if unit.kind == "train":
        _train(spec, directory, there, unit.policies)
        return
    (part,) = (part for part in spec.parts() if part.latest.start == unit.first)
    if unit.kind == "try":
        (cell,) = (cell for cell in spec.columns() if cell.name == unit.cell)
        try_and_note(part, there, cell)
    else:
        given = subjects or _subjects(part, directory, unit)
        evaluate_batch(part, there, given, statuses(part, directory))


def _train(
    spec: PanelSpec, directory: RunDirectory, there: RunDirectory, policies: Sequence[str]
) -> None:
    """Train policies together, and keep those that are not there yet."""
    units = [unit for unit in units_of(spec) if unit.policy in policies]
    own = sorted(units, key=lambda unit: policies.index(unit.policy))
    train_chunk_here(spec, there, own)
    for one in own:
        if is_there(spec, directory, one):
            there.discard_remains(one.training)
            shutil.rmtree(there.policies / one.policy)


def _subjects(spec: PanelSpec, directory: RunDirectory, unit: SharedUnit) -> list[Subject]:
    found = {one.policy: one for one in units_of(spec) if one.policy in unit.policies}
    subjects = [subject_of(spec, directory, found[policy]) for policy in unit.policies]
    told: dict[str, dict[str, tuple[int, int]]] = {}
    for policy, home, *counts in unit.at_home:
        told.setdefault(policy, {})[home] = counts[0], counts[1]
    return [
        replace(subject.waiting(unit.recorded), at_home=told.get(subject.policy.policy_id, {}))
        for subject in subjects
    ]


def _inputs(spec: PanelSpec, run: Storage, unit: SharedUnit) -> Iterator[str]:
    """Files of a run, and folders with ``/``, that a unit is done with; of a trained one, what is
    there of it already."""
    for policy in unit.policies:
        yield from (f"policies/{policy}/", f"units/train-{policy}.json")
        if unit.kind == "train":
            yield f"evidence/train-{policy}.parquet"
    if unit.kind == "evaluate":
        cells = ((part, cell) for part in spec.parts() for cell in part.columns())
        names = (f"units/{unit_of_cell(part, cell)}.json" for part, cell in cells)
        yield from (name for name in names if not (run.path / name).exists())


def _opened(run: Storage) -> tuple[PanelSpec, RunDirectory]:
    """The panel that a directory says it holds."""
    run.fetch(MANIFEST)
    manifest = json.dumps(read_manifest(run.path / MANIFEST)["specification"], sort_keys=True)
    spec = _spec(manifest)
    return spec, RunDirectory(run, spec.to_json(), spec.engine_versions())


@lru_cache(maxsize=4)
def _spec(manifest: str) -> PanelSpec:
    return planned_spec(json.loads(manifest))
