"""What `panel.json` says, held against what the plan and the records of its run come to."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import msgspec

from integ_gym.evidence.recomputing import UNFIT
from integ_gym.evidence.schema import Finding
from integ_gym.evidence.sealing import find_broken_seals
from integ_gym.evidence.store import EvidenceStore
from integ_gym.support.errors import InputError
from integ_gym.support.terminal import plural

from ..artefact import differences
from ..existing import build_given_panel, other_facts
from ..outputs import describe_look, panel_of, read_call
from ..plan import names_code, read_planned_spec
from ..result import FILE_NAME, OtherVersionError, Panel, read_panel
from ..run_directory import MANIFEST, RunDirectory, RunDirectoryError
from ..spec import PanelSpec
from .comparing import ROUNDING, denial, deny
from .plan import of_sample, planned, refuse_first


def deviations(
    directory: RunDirectory, spec: PanelSpec, said: Panel, own_code: bool
) -> Iterator[Finding]:
    """What ``panel.json`` says and is not what its run's plan and records come to.

    Args:
        directory: of the run, whose records are complete.
        spec: that its plan describes.
        said: what ``panel.json`` holds.
        own_code: whether code that a side-car names may be loaded.

    Raises:
        SpecError: for a plan that does not say the home of a policy that was given.
        ValueError: for a run that does not say how it was called, or for a panel of fewer seeds
            than were judged.
    """
    called = read_call(directory)
    if "policy" in directory.manifest()["specification"]:
        for name, *both in other_facts(spec, directory, own_code):
            yield denial(MANIFEST, None, f"given.{name}", *both, how="comes out")
        panel = build_given_panel(spec, directory, called)
    else:
        part = _part(directory, spec, said)
        panel = panel_of(part, directory, called, None if part is spec else spec)
    written = msgspec.json.decode((directory.path / FILE_NAME).read_bytes())
    for place, *both in differences(written, panel):
        yield denial(FILE_NAME, None, place, *both, how="comes out")


def _part(directory: RunDirectory, spec: PanelSpec, said: Panel) -> PanelSpec:
    """The panel, or before its verdicts were seen as many of its seeds as are reported.

    Raises:
        ValueError: for one that reports fewer seeds than were judged.
    """
    if describe_look(spec) in directory.looks():
        return spec
    seeds = max((len(row.policies) for row in said.rows if row.kind == "trained"), default=0)
    if not 0 < seeds < len(spec.seeds):
        raise InputError(f"it has {seeds} of {plural(len(spec.seeds), 'seed')}")
    return replace(spec, seeds=spec.seeds[:seeds])


_LABELS = """
SELECT policy_id, cell, failure_label, count(*) AS records
FROM records WHERE phase = 'evaluation' GROUP BY ALL
"""


def check_finished(path: Path) -> None:
    """Refuse a run whose files are not those that it was finished and sealed with.

    Raises:
        RunDirectoryError: with the first of them and the remedy.
    """
    try:
        read_panel(path / FILE_NAME)
    except OtherVersionError as error:
        raise RunDirectoryError(str(error)) from None
    except InputError:
        pass  # the plan's check says what is damaged
    directory = RunDirectory(path, {})
    refuse_first(path, against_plan(path), find_broken_seals(path), of_sample(directory))


def against_plan(
    path: Path, own_code: bool = False, all_searches: bool = False
) -> Iterator[Finding]:
    """What of a run is not as it was planned, or reported otherwise than its records say.

    Nothing for a directory that no panel was run in. Numbers of ``panel.json`` are computed again
    once the rest is in order.

    Args:
        path: the run's directory.
        own_code: whether code that the plan names as ``"module:Name"`` may be loaded; if not, of
            such a run counts and rates alone are compared.
        all_searches: whether all searches over controls are made again, or some.
    """
    found = False
    for finding in planned(path, own_code, all_searches):
        found = True
        yield finding
    file = path / FILE_NAME
    if found or not (path / MANIFEST).exists() or not file.exists():
        return
    try:
        panel = read_panel(file)
    except ValueError as error:
        yield Finding(FILE_NAME, None, str(error))
        return
    directory = RunDirectory(path, {})
    plan = directory.manifest()["specification"]
    if names_code(plan) and not own_code:
        yield from _count(directory, panel)
        return
    try:
        yield from deviations(directory, read_planned_spec(plan), panel, own_code)
    except UNFIT as error:
        message = f"cannot be made again from plan and records: {error}"
        yield Finding(FILE_NAME, None, f"{message}; run the panel's command again")


def _count(directory: RunDirectory, panel: Panel) -> Iterator[Finding]:
    """Counts and rates of the matrix that the records deny."""
    found: defaultdict[tuple[str, str], Counter[str]] = defaultdict(Counter)
    for row in EvidenceStore(directory.evidence).query(_LABELS).to_pylist():
        found[row["policy_id"], row["cell"]][row["failure_label"]] = row["records"]
    for entry in panel.matrix:
        own = [found[policy, entry.cell] for policy in panel.row(entry.row).policy_ids]
        counts = {
            "episodes": sum(one.total() for one in own),
            "labels": dict(sum(own, Counter())),
            "success_by_seed": [one["none"] / max(1, one.total()) for one in own],
        }
        said = {name: getattr(entry, name) for name in counts}
        place = f"matrix[{entry.row}, {entry.cell}]"
        yield from deny(FILE_NAME, None, place, said, counts, "comes out", tolerance=ROUNDING)
