"""A finished run held against its own plan: units, policies and records."""

from __future__ import annotations

import random
from collections import defaultdict
from collections.abc import Iterator, Mapping
from contextlib import suppress
from itertools import chain
from pathlib import Path
from typing import Any

from integ_gym.envs.engines.stepping import engine_versions
from integ_gym.evidence.fields import FIRST_WRITTEN, SCHEMA_VERSION
from integ_gym.evidence.recomputing import UNFIT, recompute
from integ_gym.evidence.replaying import replay_some
from integ_gym.evidence.schema import Finding
from integ_gym.evidence.sealing import SEAL_FILE
from integ_gym.evidence.store import EvidenceStore
from integ_gym.support.terminal import plural
from integ_gym.train.policy_files.reading import read_weights
from integ_gym.train.policy_files.sidecar import (
    WEIGHTS_FILE,
    policy_file,
    read_trained,
    readable_file,
)

from ..achieve import unit_of_cell
from ..cells import SpecError
from ..evaluate import evaluated
from ..plan import inputs, names_code, read_planned_home, read_planned_spec
from ..policies import ActingIn, hashes_of
from ..result import FILE_NAME, read_panel
from ..run_directory import (
    MANIFEST,
    RunDirectory,
    RunDirectoryError,
    first_of,
    package_versions,
    read_manifest,
)
from ..spec import PanelSpec
from ..units import is_card_of, trained_units
from . import setups
from .comparing import deny
from .yardsticks import of_attempts, of_contracts, of_replays

EVALUATION, TRIED = "evaluate-", "achieve-"
"""How the names of units begin that evaluate policies, and that try cells."""

_EVALUATED = """
SELECT policy_id, cell, count(DISTINCT episode_index) AS present, min(episode_index) AS first,
       max(episode_index) AS last, count(*) AS records
FROM records WHERE phase = 'evaluation' GROUP BY ALL ORDER BY policy_id, cell
"""

_EARLIER = f"""
SELECT schema_version, count(*) AS records FROM records
WHERE schema_version < {FIRST_WRITTEN} GROUP BY ALL ORDER BY schema_version
"""

_WHOSE = """
SELECT run_id, phase, policy_id, policy_hash, count(*) AS records
FROM records GROUP BY ALL ORDER BY run_id, policy_id
"""


def planned(path: Path, own_code: bool, all_searches: bool = False) -> Iterator[Finding]:
    """What of a run is not as it was planned; nothing for a directory that no panel was run in.

    Args:
        path: the run's directory.
        own_code: whether code that the plan names as ``"module:Name"`` may be loaded.
        all_searches: whether all searches over controls are made again, or some.
    """
    directory = _Sound(path, {})
    if not (path / MANIFEST).exists():
        if (path / FILE_NAME).exists() or any((path / "units").glob("*.json")):
            yield Finding(MANIFEST, None, "is missing, which says what was planned")
        return
    try:
        manifest = read_manifest(path / MANIFEST)
        plan = manifest["specification"]
        spec = read_planned_spec(plan)
        policies = setups.planned_policies(plan, spec)
        units = {unit.policy: unit for unit in trained_units(spec)}
        can_load = own_code or not names_code(plan)
    except SpecError as error:
        yield Finding(MANIFEST, None, f"{error}; restore it from a copy")
        return
    except UNFIT as error:
        yield Finding(MANIFEST, None, unfit(error))
        return
    found, versions = evaluated(directory, lost=True), manifest["versions"]
    run = setups.PlannedRun(directory, plan, spec, versions, policies, units, found, can_load)
    is_present = _is_of_this_version(directory, versions)
    is_whole = is_present and is_finished(directory, spec)
    parts = (
        directory.faults(),
        _of_looks(directory, spec, is_present),
        _of_schema(run.store) if is_present else iter(()),
        _find_missing_units(run) if can_load else iter(()),
        _of_policies(run),
        _of_records(run),
        _of_evaluations(run),
        setups.of_setups(run),
        setups.of_training(run),
        setups.of_versions(versions, run.store),
        of_replays(run) if can_load else iter(()),
        of_attempts(run, all_searches) if can_load else iter(()),
        of_contracts(run, is_whole) if can_load else iter(()),
    )
    for part in parts:
        try:
            yield from part
        except UNFIT as error:  # what cannot be read ends its own part alone
            yield Finding(MANIFEST, None, unfit(error))


def unfit(error: Exception) -> str:
    """What such an error says, in a sentence."""
    if isinstance(error, ValueError):
        return str(error)
    what = f"{type(error).__name__}: {error}"
    return f"the run cannot be held against its plan ({what}); restore it from a copy"


class _Sound(RunDirectory):
    """A run without the markers that cannot be read, which are findings of their own."""

    def markers(self, prefix: str) -> dict[str, Mapping[str, Any]]:
        return self.readable_markers(prefix)[0]


def _is_of_this_version(directory: RunDirectory, versions: Mapping[str, str]) -> bool:
    """Whether manifest or page says that this version made the run."""
    own = "integ-gym"
    if versions.get(own) == package_versions()[own]:
        return True
    with suppress(ValueError):
        read_panel(directory.path / FILE_NAME)  # which reads no other schema
        return True
    return False


def _of_schema(store: EvidenceStore) -> Iterator[Finding]:
    """Records of an earlier schema, which less is asked of, in a run of this version."""
    for row in store.query(_EARLIER).to_pylist():
        message = (
            f"{plural(row['records'], 'record')} of schema version {row['schema_version']} in a "
            f"run of the version that writes {SCHEMA_VERSION}"
        )
        yield Finding("evidence", None, message)


def _of_looks(directory: RunDirectory, spec: PanelSpec, is_present: bool) -> Iterator[Finding]:
    """Looks that are gone, or at more seeds than are planned, or at episodes that came at no time.

    Looks in a run whose policies were taken are that run's.
    """
    for unit in directory.lost_looks(is_present):
        message = f"`looks` are not those after which unit {unit} says that it was finished"
        yield Finding(MANIFEST, None, message)
    looks = [look for look in directory.looks() if look.spent is None]
    seeds, episodes = [look.seeds for look in looks], [look.episodes for look in looks]
    planned_episodes = sorted({part.episodes for part in spec.parts()})
    if any(count > max(1, len(spec.seeds)) for count in seeds):
        message = f"`looks` is on {seeds} seeds, and {len(spec.seeds)} are planned"
        yield Finding(MANIFEST, None, message)
    if not set(episodes) <= set(planned_episodes):
        message = f"`looks` is on {episodes} episodes, and episodes came up to {planned_episodes}"
        yield Finding(MANIFEST, None, message)


def is_finished(directory: RunDirectory, spec: PanelSpec) -> bool:
    """Whether all that is planned must be there: it was sealed, or verdicts on it were seen."""
    seen = [(look.seeds, look.episodes) for look in directory.looks() if look.spent is None]
    return (directory.path / SEAL_FILE).exists() or (len(spec.seeds), spec.episodes) in seen


def _find_missing_units(run: setups.PlannedRun) -> Iterator[Finding]:
    """Units of a finished run that its plan has, and of which nothing is left."""
    spec, found = run.spec, run.found
    if not is_finished(run.directory, spec):
        return
    wanted = [f"train-{name}" for name in run.units]
    wanted += [unit_of_cell(part, cell) for part in spec.parts() for cell in part.columns()]
    for unit in sorted({*wanted} - run.directory.markers("").keys()):
        yield Finding("units", None, f"{unit}.json is missing, which the plan has")
    for policy, own in run.policies.items():
        cells = {cell.name for cell in spec.cells_of(own.home)}
        if policy not in found:
            yield Finding("units", None, f"policy {policy!r}, which the plan has, is not evaluated")
        elif lost := sorted(cells - found[policy].cells):
            message = f"policy {policy!r} is not evaluated in {len(lost)} cells of the plan"
            yield Finding("units", None, f"{message}, {lost[0]!r} among them")


def _of_policies(run: setups.PlannedRun) -> Iterator[Finding]:
    """Policies that are not those that were trained or evaluated."""
    found, markers = run.found, run.directory.markers("train-")
    trained = {unit.removeprefix("train-"): marker for unit, marker in markers.items()}
    for policy in {**found, **trained}:
        if policy not in run.policies:
            yield Finding("units", None, f"policy {policy!r} is none of the plan's")
            continue
        folder, name = run.directory.policies / policy, f"policies/{policy}"
        if policy in trained and not policy_file(folder).exists():
            yield Finding(name, None, "is missing")
            continue
        try:
            if policy in trained:
                same = _is_trained(folder, trained[policy])
            else:  # what did not come as a file has no hash there
                hashes = hashes_of(folder)
                same = not hashes or found[policy].policy_hash in hashes
        except ValueError as error:
            yield Finding(name, None, str(error))
            continue
        if not same:
            yield Finding(name, None, "is not the policy that this run was made with")
        elif policy in trained:
            card = read_trained(readable_file(folder))[1]
            yield from run.training_faults(folder, card, run.units[policy], trained[policy])


def _of_evaluations(run: setups.PlannedRun) -> Iterator[Finding]:
    """Units that began with other episodes or inputs than the plan has."""
    spec, plan, directory = run.spec, run.plan, run.directory
    homes = (*spec.train, None, *((read_planned_home(plan),) if "policy" in plan else ()))
    cells = spec.cells_by_name(homes) if run.can_load else {}
    parts = {part.latest.start: part for part in spec.parts()}
    markers = {**directory.markers(EVALUATION), **directory.markers(TRIED)}
    for unit, marker in markers.items():
        file, part = f"units/{unit}.json", parts.get(first_of(marker))
        if part is None:
            message = f"`first` is {first_of(marker)}, where the plan begins no episodes"
            yield Finding(file, None, message)
            continue
        last = "cell" if "cell" in marker else "policies"
        held = [[marker["cell"]]] if last == "cell" else marker["cells"].values()
        names = dict.fromkeys(chain.from_iterable(held))
        if not names.keys() <= cells.keys():
            continue  # records of a cell that is not planned are found as such
        where = [cells[name] for name in names]
        engines = engine_versions({cell.discretization.engine for cell in where})
        given = {**inputs(part, where), "trainer": plan["trainer"]}
        wanted = setups.planned_key(run.versions, engines, **{"spec": given, last: marker[last]})
        yield from deny(file, None, "key", marker["key"], wanted)


def _is_trained(folder: Path, marker: Mapping[str, Any]) -> bool:
    """Whether policy, side-car and copy of the weights are what a training unit ended with."""
    _, card = read_trained(readable_file(folder))
    copy = folder / WEIGHTS_FILE
    same = not copy.exists() or read_weights(copy).content_hash == card["content_hash"]
    return same and is_card_of(card, marker)


def _of_records(run: setups.PlannedRun) -> Iterator[Finding]:
    """Records of other runs or policies, and cells without all their episodes."""
    spec, store, found = run.spec, run.store, run.found
    for row in store.query(_WHOSE).to_pylist():
        policy, whose = row["policy_id"], f"{row['records']} records of policy {row['policy_id']!r}"
        if row["run_id"] != spec.name:
            yield Finding("evidence", None, f"{whose} are of run {row['run_id']!r}")
        elif row["phase"] == "evaluation" and policy not in found:
            yield Finding("evidence", None, f"{whose}, which no unit evaluated")
        elif row["phase"] == "evaluation" and row["policy_hash"] != found[policy].policy_hash:
            yield Finding("evidence", None, f"{whose} are of another policy of that name")
    cells: defaultdict[str, dict[str, tuple[int, int, int]]] = defaultdict(dict)
    for row in store.query(_EVALUATED).to_pylist():
        if row["records"] > row["present"]:
            have = f"{row['records']} records of {row['present']} episodes in cell {row['cell']!r}"
            yield Finding("evidence", None, f"policy {row['policy_id']!r} has {have}")
        cells[row["policy_id"]][row["cell"]] = row["present"], row["first"], row["last"]
    for policy, there in found.items():
        if not cells[policy]:
            yield Finding("evidence", None, f"policy {policy!r} has no evaluation records")
            continue
        for cell in sorted({*there.cells, *cells[policy]}):
            episodes = cells[policy].get(cell, (0, 0, -1))
            if episodes != (spec.episodes, 0, spec.episodes - 1):
                have = f"has {episodes[0]} of {spec.episodes} episodes in cell {cell!r}"
                yield Finding("evidence", None, f"policy {policy!r} {have}")


SAMPLED = 128
"""Records that are recomputed and played again before a page is written, of two files or more."""


def check_records(directory: RunDirectory) -> None:
    """Refuse records that no unit was finished with, or whose outcomes their traces deny.

    Of the latter a sample is recomputed and played again; `integ-gym evidence verify --all` does
    that with all.

    Raises:
        RunDirectoryError: with the first of them and the remedy.
    """
    refuse_first(directory.path, directory.faults(), of_sample(directory))


def refuse_first(path: Path, *findings: Iterator[Finding]) -> None:
    """Refuse a run if anything is found.

    Raises:
        RunDirectoryError: with the first finding and the remedy.
    """
    for finding in chain.from_iterable(findings):
        raise RunDirectoryError(
            f"{path / finding.file}: {finding.message}; restore it from a copy, or remove it and "
            "run the panel's command again, which does what is missing"
        )


def of_sample(directory: RunDirectory) -> Iterator[Finding]:
    """Outcomes that their traces deny, and episodes that environments and policies deny.

    These are evaluation records whose number the plan does not give.
    """
    store = EvidenceStore(directory.evidence)
    files = [file.name for file in store.files() if file.name.startswith(EVALUATION)]
    random.shuffle(files)
    left, most = SAMPLED, SAMPLED // min(2, max(1, len(files)))
    while files and left > 0:
        name = files.pop()
        records = store.some_records(name, most)
        left -= len(records)
        for record in records:
            yield from recompute(record, f"evidence/{name}")
        own, chance = store.only(name), random.Random()
        yield from replay_some(own, most, chance, ActingIn(store)).findings
