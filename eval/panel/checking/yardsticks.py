"""What judges a policy beside its own episodes, held against the records that it stands for.

Second horizons and attempts of hand-made controllers are records. What a record says of replays and
of its cell, and what a marker says of attempts, must follow from them; searches are made again.
"""

from __future__ import annotations

import math
import random
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import msgspec
import numpy as np
import numpy.typing as npt

from integ_gym.envs.engines.stepping import missing_modules
from integ_gym.envs.settings import Discretization
from integ_gym.evidence.fields import ATTEMPT, LATER_ATTEMPT, SECOND_HORIZON
from integ_gym.evidence.schema import Finding, argument_values
from integ_gym.evidence.store import EvidenceStore

from ..achieve import search_of, tried_in, unit_of_cell
from ..cells import Cell, Home, is_engine
from ..contracts import PREFIX as COMPARED
from ..contracts import (
    Contracts,
    contract_of,
    contracts_in,
    describe_comparison,
    engines_of,
    key_parts,
    pairs_of,
)
from ..episodes import Successes
from ..evaluate import Evaluated, statuses
from ..run_directory import RunDirectory
from ..spec import PanelSpec
from ..units import HANDMADE, baseline_of, has_controller
from .setups import PlannedPolicy, planned_key

Flags = npt.NDArray[np.bool_]

SEARCHES = 4
"""Searches over controls that are made again, where not all are."""

RECORDS_SINCE = 4
"""Schema version since which second horizons and attempts are records."""

COMPARED_SINCE = 6
"""Schema version since which records say whether the contract of home is kept."""

_COLUMNS = (
    *("replay_home", "replay_without_noise", "replay_without_delay", "replay_second_horizon"),
    *("home_success", "cell_status", "contract_kept"),
)

_PLAIN = " AND ".join(f"{{0}}{name} IS NULL" for name in _COLUMNS)
"""Whether records say nothing of replays, as those of second horizons and attempts do."""

_EVALUATED = f"""
SELECT record_id, policy_id, cell, episode_index, success, schema_version, {", ".join(_COLUMNS)}
FROM records WHERE phase = 'evaluation' ORDER BY policy_id, cell, episode_index
"""

_LATER = f"""
SELECT s.record_id, s.policy_id, s.cell, s.episode_index, s.success, s.trace_every,
       s.arguments, e.arguments AS own, s.seed IS NOT DISTINCT FROM e.seed
       AND s.policy_hash = e.policy_hash AND s.engine IS NOT DISTINCT FROM e.engine
       AND s.perturbation IS NOT DISTINCT FROM e.perturbation
       AND s.training_discretization IS NOT DISTINCT FROM e.training_discretization
       AND s.training_seed IS NOT DISTINCT FROM e.training_seed
       AND s.rng_key IS NOT DISTINCT FROM e.rng_key
       AND s.float_width IS NOT DISTINCT FROM e.float_width
       AND {_PLAIN.format("s.")} AS same
FROM records s LEFT JOIN (SELECT * FROM records WHERE phase = 'evaluation') e
ON s.policy_id = e.policy_id AND s.cell = e.cell AND s.episode_index = e.episode_index
WHERE s.phase = '{SECOND_HORIZON}'
"""

_ATTEMPTS = f"""
SELECT record_id, phase, cell, policy_id, policy_hash, episode_index, seed, success, arguments,
       trace_every, perturbation, training_discretization, training_seed, rng_key, float_width,
       {_PLAIN.format("")} AS plain
FROM records WHERE phase IN ('{ATTEMPT}', '{LATER_ATTEMPT}')
"""

_SETUPS = """
SELECT cell, any_value(arguments) AS arguments, any_value(float_width) AS float_width FROM records
WHERE phase = 'evaluation' GROUP BY cell
"""


def of_replays(
    directory: RunDirectory,
    found: Mapping[str, Evaluated],
    spec: PanelSpec,
    policies: Mapping[str, PlannedPolicy],
    given: bool,
) -> Iterator[Finding]:
    """Records whose replays, home or cell are not what other records come to.

    Args:
        directory: of the run.
        found: where each policy was evaluated.
        spec: of the run.
        policies: of its plan, by id.
        given: whether the run judges a policy that was given, so that its home may be unknown.
    """
    store = EvidenceStore(directory.evidence)
    later: dict[tuple[str, str], dict[int, bool]] = defaultdict(dict)
    for row in store.query(_LATER).to_pylist():
        if not row["same"] or not _is_twice(spec, row["arguments"], row["own"]):
            message = "is no second horizon of an evaluation: seed, policy or setup is another"
            yield Finding("evidence", row["record_id"], message)
        parts = (one for one in spec.parts() if row["episode_index"] in one.latest)
        yield from _of_row(row, {"trace_every": next(parts, spec).episodes})
        later[row["policy_id"], row["cell"]][row["episode_index"]] = row["success"]
    rows: dict[str, dict[str, list[dict[str, Any]]]] = defaultdict(lambda: defaultdict(list))
    for row in store.query(_EVALUATED).to_pylist():
        if row["schema_version"] > 1:  # which did not keep what its labels rest on
            rows[row["policy_id"]][row["cell"]].append(row)
    can = [(part, statuses(part, directory)) for part in spec.parts()]
    contracts = contracts_in(directory)
    for policy in policies.keys() & rows.keys() & found.keys():
        before: dict[Discretization, tuple[int, int]] = {}
        undisturbed = {
            cell.name: cell.discretization
            for cell in spec.cells_of(policies[policy].home)
            if cell.changes is None
        }
        for part, status in can:
            own = {
                cell: [row for row in held if row["episode_index"] in part.latest]
                for cell, held in rows[policy].items()
            }
            whole = {cell: held for cell, held in own.items() if len(held) == len(part.latest)}
            unknown = given and policies[policy].home is None and policy not in spec.baselines
            told = contracts, whole, later, status, before
            yield from _of_policy(part, policies[policy], unknown, *told)
            for name in whole.keys() & undisturbed.keys():
                count, total = before.get(undisturbed[name], (0, 0))
                succeeded = sum(bool(row["success"]) for row in whole[name])
                before[undisturbed[name]] = count + succeeded, total + len(whole[name])


def _of_policy(
    spec: PanelSpec,
    policy: PlannedPolicy,
    unknown: bool,
    contracts: Contracts,
    rows: Mapping[str, list[dict[str, Any]]],
    later: Mapping[tuple[str, str], Mapping[int, bool]],
    status: Mapping[str, str],
    before: Mapping[Discretization, tuple[int, int]],
) -> Iterator[Finding]:
    """What the records of one policy, from the starts that came last, say of its replays."""
    cells = [cell for cell in spec.cells_of(policy.home) if cell.name in rows]
    successes = Successes(
        [policy.home], [cells], spec.environment, spec.latest.start, status,
        whole=spec.testbed.batched, before=[before] if spec.latest.start else [],
        homeless=[0] if unknown else [], contracts=contracts,
    )  # fmt: skip
    for cell in cells:
        held = rows[cell.name]
        flags = np.array([bool(row["success"]) for row in held])
        second = later.get((held[0]["policy_id"], cell.name), {})
        recovered: Flags | None = None
        if spec.twice_the_time is not None:
            if held[0]["schema_version"] < RECORDS_SINCE:  # what cannot be derived is believed
                told = [bool(row["replay_second_horizon"]) for row in held]
            else:
                told = []
                for row, success in zip(held, flags, strict=True):
                    if not success and row["episode_index"] not in second:
                        message = "its second horizon is missing"
                        yield Finding("evidence", row["record_id"], message)
                    told.append(bool(success or second.get(row["episode_index"])))
            recovered = np.array(told)
        successes.note(cell, [0], flags[None], None if recovered is None else recovered[None])
    for cell in cells:
        (replays,) = successes.replays(cell, [0])
        for row in rows[cell.name]:
            made = replays[row["episode_index"]].columns()
            compared = row["schema_version"] >= COMPARED_SINCE
            for name in _COLUMNS if compared else _COLUMNS[:-1]:
                if not _same(row[name], made[name]):
                    message = f"`{name}` is recorded as {row[name]!r}, and comes out as"
                    yield Finding("evidence", row["record_id"], f"{message} {made[name]!r}")


def of_attempts(directory: RunDirectory, spec: PanelSpec, all_searches: bool) -> Iterator[Finding]:
    """What markers say of attempts and searches, and their records and the search do not come to.

    Args:
        directory: of the run.
        spec: of the run.
        all_searches: whether all are made again, or some.
    """
    store = EvidenceStore(directory.evidence)
    held: dict[str, dict[str, dict[int, dict[str, Any]]]] = defaultdict(lambda: defaultdict(dict))
    for row in store.query(_ATTEMPTS).to_pylist():
        held[row["cell"]][row["phase"]][row["episode_index"]] = row
    setups = {row["cell"]: row for row in store.query(_SETUPS).to_pylist()}
    oldest = store.query("SELECT min(schema_version) AS v FROM records WHERE phase = 'evaluation'")
    recorded = (oldest.to_pylist()[0]["v"] or 0) >= RECORDS_SINCE
    searched = []
    for part in spec.parts():
        for cell in part.columns():
            unit = unit_of_cell(part, cell)
            marker = directory.marker(unit)
            if marker is None:
                continue
            told = tried_in(marker)
            if told.search is not None:
                searched.append((part, cell, unit))
            if (told.search is not None) and told.solved:
                yield _of_marker(unit, "search", "made", "not needed")
            if "records" not in marker and not recorded:
                continue  # of before attempts were records
            if has_controller(part):
                yield from _of_rows(part, cell, unit, held[cell.name], setups.get(cell.name))
                success, recovered = _outcomes(part, held[cell.name])
            else:
                success = recovered = ()
            for name, made in (("success", success), ("recovered", recovered)):
                if tuple(marker[name]) != made:
                    yield _of_marker(unit, name, marker[name], list(made))
    random.shuffle(searched)
    for part, cell, unit in searched if all_searches else searched[:SEARCHES]:
        yield from _searched_again(directory, part, cell, unit)


def of_contracts(
    directory: RunDirectory,
    spec: PanelSpec,
    homes: Iterable[Home | None],
    versions: Mapping[str, str],
    whole: bool,
) -> Iterator[Finding]:
    """Comparisons of engines that are missing, or that come out otherwise when made again.

    Those of engines that are not installed here are believed.

    Args:
        directory: of the run.
        spec: of the run.
        homes: of its policies.
        versions: of the run's manifest.
        whole: whether all that is planned must be there.
    """
    pairs, markers = pairs_of(spec, homes), directory.markers(COMPARED)
    for unit in markers.keys() - pairs.keys():
        yield Finding(f"units/{unit}.json", None, "compares what the plan does not have")
    for unit, pair in pairs.items():
        marker = markers.get(unit)
        if marker is None:
            if whole:
                yield Finding("units", None, f"{unit}.json is missing, which the plan has")
            continue
        key = planned_key(versions, engines_of(pair), **key_parts(spec, pair))
        if marker["key"] != key:
            yield _of_marker(unit, "key", marker["key"], key)
        if any(is_engine(one.engine) and missing_modules(one.engine) for one in pair):
            continue
        for name, made in describe_comparison(pair, contract_of(spec, pair)).items():
            if not _same(marker.get(name), msgspec.json.decode(msgspec.json.encode(made))):
                yield _of_marker(unit, name, marker.get(name), made)


def _outcomes(
    spec: PanelSpec, rows: Mapping[str, Mapping[int, Mapping[str, Any]]]
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Success of the attempts from the starts that came last, within one horizon and two."""
    places = [
        spec.attempt(place, episode)
        for place in range(len(spec.start_sets))
        for episode in spec.latest
    ]
    one, two = rows.get(ATTEMPT, {}), rows.get(LATER_ATTEMPT, {})
    success = [bool(one[k]["success"]) if k in one else False for k in places]
    again = [bool(two[k]["success"]) if k in two else False for k in places]
    recovered = [a or b for a, b in zip(success, again, strict=True)]
    return tuple(map(float, success)), tuple(map(float, recovered))


def _of_rows(
    spec: PanelSpec,
    cell: Cell,
    unit: str,
    rows: Mapping[str, Mapping[int, Mapping[str, Any]]],
    setup: Mapping[str, Any] | None,
) -> Iterator[Finding]:
    """Attempts that are missing, or are not what was to be tried.

    Args:
        spec: the panel.
        cell: where.
        unit: that tried it.
        rows: records of the attempts, by phase and number.
        setup: what evaluations in the cell say of it; None without any.
    """
    file, arguments = f"evidence/{unit}.parquet", None if setup is None else setup["arguments"]
    controller = baseline_of(spec, HANDMADE).content_hash
    twice = spec.twice_the_time is not None
    for place, starts in enumerate(spec.start_sets):
        failed = False
        numbers = {spec.attempt(place, episode): episode for episode in spec.latest}
        for number, episode in numbers.items():
            row = rows.get(ATTEMPT, {}).get(number)
            if row is None:
                yield Finding(file, None, f"attempt {number} in cell {cell.name!r} is missing")
                continue
            failed = failed or not row["success"]
            seed = spec.start_seed(starts, episode)
            yield from _of_attempt(row, seed, controller, spec, setup)
            if arguments is not None and argument_values(row["arguments"]) != argument_values(
                arguments
            ):
                yield Finding(file, row["record_id"], "its setup is not that of its cell")
        if not (failed and twice):
            continue
        for number, episode in numbers.items():
            row = rows.get(LATER_ATTEMPT, {}).get(number)
            if row is None:
                message = f"the second horizon of attempt {number} in cell {cell.name!r} is missing"
                yield Finding(file, None, message)
                continue
            seed = spec.start_seed(starts, episode)
            yield from _of_attempt(row, seed, controller, spec, setup)
            if not _is_twice(spec, row["arguments"], arguments):
                yield Finding(file, row["record_id"], "its setup is not that of its cell")


def _of_attempt(
    row: Mapping[str, Any],
    seed: int,
    controller: str,
    spec: PanelSpec,
    setup: Mapping[str, Any] | None,
) -> Iterator[Finding]:
    """What an attempt's record says that is not as it was to be tried."""
    wanted: dict[str, Any] = {"seed": seed, "policy_hash": controller, "policy_id": HANDMADE}
    wanted |= {"perturbation": None, "training_discretization": None, "training_seed": None}
    wanted |= {"rng_key": f"{seed}/0"}
    wanted |= {} if setup is None else {"float_width": setup["float_width"]}
    wanted |= {"plain": True, "trace_every": len(spec.start_sets) * spec.episodes}
    yield from _of_row(row, wanted)


def _of_row(row: Mapping[str, Any], wanted: Mapping[str, Any]) -> Iterator[Finding]:
    for name, value in wanted.items():
        if row[name] != value:
            message = f"`{name}` is recorded as {row[name]!r}, and planned as {value!r}"
            yield Finding("evidence", row["record_id"], message)


def _searched_again(
    directory: RunDirectory, spec: PanelSpec, cell: Cell, unit: str
) -> Iterator[Finding]:
    """What a search says that comes out otherwise when it is made again."""
    marker = directory.marker(unit)
    assert marker is not None
    again = search_of(spec, cell)
    made = {} if again is None else msgspec.json.decode(msgspec.json.encode(again))
    for name, value in marker["search"].items():
        if not _same(value, made.get(name)):
            yield _of_marker(unit, f"search.{name}", value, made.get(name))


def _of_marker(unit: str, name: str, said: Any, made: Any) -> Finding:
    message = f"`{name}` is recorded as {said!r:.80}, and comes out as {made!r:.80}"
    return Finding(f"units/{unit}.json", None, message)


def _is_twice(spec: PanelSpec, arguments: str, own: str | None) -> bool:
    """Whether arguments are those of a cell with twice the time; where none are known, they are."""
    if own is None:
        return False
    return argument_values(arguments) == {**argument_values(own), **(spec.twice_the_time or {})}


def _same(said: Any, made: Any) -> bool:
    if isinstance(said, list) and isinstance(made, list):
        return len(said) == len(made) and all(map(_same, said, made))
    if isinstance(said, dict) and isinstance(made, dict):
        return said.keys() == made.keys() and all(_same(said[k], made[k]) for k in said)
    if isinstance(said, float) and isinstance(made, float):
        return math.isclose(said, made, rel_tol=1e-6, abs_tol=1e-9)
    return bool(said == made)
