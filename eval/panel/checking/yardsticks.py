"""What judges a policy beside its own episodes, held against the records that it stands for.

Second horizons and attempts of hand-made controllers are records. What a record says of replays and
of its cell, and what a marker says of attempts, must follow from them; searches are made again.
"""

from __future__ import annotations

import random
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from itertools import product
from typing import Any

import msgspec
import numpy as np

from integ_gym.envs.engines.stepping import is_engine, missing_modules
from integ_gym.envs.settings import Discretization
from integ_gym.evidence.fields import ATTEMPT, LATER_ATTEMPT, SECOND_HORIZON
from integ_gym.evidence.schema import Finding, argument_values

from ..achieve import read_tried, search_of, unit_of_cell
from ..cells import Cell
from ..contracts import PREFIX as COMPARED
from ..contracts import (
    contract_of,
    contracts_in,
    describe_comparison,
    engines_of,
    key_parts,
    pairs_of,
)
from ..episodes import Successes
from ..evaluate import statuses
from ..spec import PanelSpec
from ..units import HANDMADE, baseline_of, has_controller
from .comparing import ROUNDING, deny
from .setups import PlannedRun, planned_key

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


def of_replays(run: PlannedRun) -> Iterator[Finding]:
    """Records whose replays, home or cell are not what other records come to."""
    spec, store, policies = run.spec, run.store, run.policies
    later: dict[tuple[str, str], dict[int, bool]] = defaultdict(dict)
    for row in store.query(_LATER).to_pylist():
        if not row["same"] or not _has_setup(row, row["own"], spec.twice_the_time):
            message = "is no second horizon of an evaluation: seed, policy or setup is another"
            yield Finding("evidence", row["record_id"], message)
        parts = (one for one in spec.parts() if row["episode_index"] in one.latest)
        yield from _of_row(row, {"trace_every": next(parts, spec).episodes})
        later[row["policy_id"], row["cell"]][row["episode_index"]] = row["success"]
    rows: dict[str, dict[str, list[dict[str, Any]]]] = defaultdict(lambda: defaultdict(list))
    for row in store.query(_EVALUATED).to_pylist():
        if row["schema_version"] > 1:  # which did not keep what its labels rest on
            rows[row["policy_id"]][row["cell"]].append(row)
    can = [(part, statuses(part, run.directory)) for part in spec.parts()]
    contracts, is_given = contracts_in(run.directory), "policy" in run.plan
    for policy in policies.keys() & rows.keys() & run.found.keys():
        home = policies[policy].home
        before: dict[Discretization, tuple[int, int]] = {}
        for part, status in can:
            cells = [  # those with all their episodes
                (cell, held)
                for cell in part.cells_of(home)
                if len(held := [x for x in rows[policy][cell.name] if _is_of(part, x)])
                == len(part.latest)
            ]
            successes = Successes(
                [home], [[cell for cell, _ in cells]], part.environment, part.latest.start, status,
                whole=part.testbed.batched, before=[{**before}] if part.latest.start else [],
                homeless=[0] if is_given and home is None and policy not in spec.baselines else [],
                contracts=contracts,
            )  # fmt: skip
            for cell, held in cells:
                second = later.get((policy, cell.name), {})
                yield from _note(successes, cell, held, second, part.twice_the_time is not None)
            for cell, held in cells:
                yield from _of_labels(successes, cell, held)
                if cell.changes is None:
                    count, total = before.get(cell.discretization, (0, 0))
                    succeeded = sum(bool(row["success"]) for row in held)
                    before[cell.discretization] = count + succeeded, total + len(held)


def _is_of(part: PanelSpec, row: Mapping[str, Any]) -> bool:
    """Whether an episode is among those that came last."""
    return row["episode_index"] in part.latest


def _note(
    successes: Successes,
    cell: Cell,
    held: Sequence[Mapping[str, Any]],
    second: Mapping[int, bool],
    twice: bool,
) -> Iterator[Finding]:
    """Take in what the records of one policy in a cell say; what is missing of second horizons."""
    flags, recovered = np.array([bool(row["success"]) for row in held]), None
    if twice and held[0]["schema_version"] < RECORDS_SINCE:  # what cannot be derived is believed
        recovered = np.array([bool(row["replay_second_horizon"]) for row in held])
    elif twice:
        for row in held:
            if not row["success"] and row["episode_index"] not in second:
                message = "its second horizon is missing"
                yield Finding("evidence", row["record_id"], message)
        recovered = flags | [bool(second.get(row["episode_index"])) for row in held]
    successes.note(cell, [0], flags[None], None if recovered is None else recovered[None])


def _of_labels(
    successes: Successes, cell: Cell, held: Sequence[Mapping[str, Any]]
) -> Iterator[Finding]:
    """What the records of one policy in a cell say of its replays."""
    (replays,) = successes.replays(cell, [0])
    for row in held:
        replayed = replays[row["episode_index"]].columns()
        compared = row["schema_version"] >= COMPARED_SINCE
        for name in _COLUMNS if compared else _COLUMNS[:-1]:
            both = row[name], replayed[name]
            yield from deny("evidence", row["record_id"], name, *both, "comes out")


def of_attempts(run: PlannedRun, all_searches: bool) -> Iterator[Finding]:
    """What markers say of attempts and searches, and their records and the search do not come to.

    Args:
        run: the run.
        all_searches: whether all are made again, or some.
    """
    store = run.store
    held: dict[str, dict[str, dict[int, dict[str, Any]]]] = defaultdict(lambda: defaultdict(dict))
    for row in store.query(_ATTEMPTS).to_pylist():
        held[row["cell"]][row["phase"]][row["episode_index"]] = row
    setups = {row["cell"]: row for row in store.query(_SETUPS).to_pylist()}
    oldest = store.query("SELECT min(schema_version) AS v FROM records WHERE phase = 'evaluation'")
    recorded = (oldest.to_pylist()[0]["v"] or 0) >= RECORDS_SINCE
    searched = []
    for part in run.spec.parts():
        for cell in part.columns():
            unit = unit_of_cell(part, cell)
            marker = run.directory.marker(unit)
            if marker is None:
                continue
            file, attempts = f"units/{unit}.json", read_tried(marker)
            if attempts.search is not None:
                searched.append((part, cell, file, marker["search"]))
                if attempts.solved:
                    yield from deny(file, None, "search", "made", "not needed", "comes out")
            if "records" not in marker and not recorded:
                continue  # of before attempts were records
            rates: dict[str, list[float]] = {"success": [], "recovered": []}
            if has_controller(part):
                yield from _of_rows(part, cell, unit, held[cell.name], setups.get(cell.name))
                rates = _outcomes(part, held[cell.name])
            said = {name: marker[name] for name in rates}
            yield from deny(file, None, "", said, rates, "comes out")
    random.shuffle(searched)
    for part, cell, file, search in searched if all_searches else searched[:SEARCHES]:
        again = msgspec.to_builtins(search_of(part, cell))
        yield from deny(file, None, "search", search, again, "comes out", tolerance=ROUNDING)


def of_contracts(run: PlannedRun, whole: bool) -> Iterator[Finding]:
    """Comparisons of engines that are missing, or that come out otherwise when made again.

    Those of engines that are not installed here are believed.

    Args:
        run: the run.
        whole: whether all that is planned must be there.
    """
    spec, markers = run.spec, run.directory.markers(COMPARED)
    pairs = pairs_of(spec, [policy.home for policy in run.policies.values()])
    for unit in markers.keys() - pairs.keys():
        yield Finding(f"units/{unit}.json", None, "compares what the plan does not have")
    for unit, pair in pairs.items():
        if unit not in markers:
            if whole:
                yield Finding("units", None, f"{unit}.json is missing, which the plan has")
            continue
        expected = {"key": planned_key(run.versions, engines_of(pair), **key_parts(spec, pair))}
        if not any(is_engine(one.engine) and missing_modules(one.engine) for one in pair):
            expected |= describe_comparison(pair, contract_of(spec, pair))
        said = {name: markers[unit].get(name) for name in expected}
        file = f"units/{unit}.json"
        yield from deny(file, None, "", said, expected, "comes out", tolerance=ROUNDING)


def _outcomes(
    spec: PanelSpec, rows: Mapping[str, Mapping[int, Mapping[str, Any]]]
) -> dict[str, list[float]]:
    """Success of the attempts from the starts that came last, within one horizon and two."""
    places = product(range(len(spec.start_sets)), spec.latest)
    numbers = [spec.attempt(place, episode) for place, episode in places]
    success, again = (
        [float(k in own and own[k]["success"]) for k in numbers]
        for own in (rows.get(phase, {}) for phase in (ATTEMPT, LATER_ATTEMPT))
    )
    return {"success": success, "recovered": list(map(max, success, again))}


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
    file, twice = f"evidence/{unit}.parquet", spec.twice_the_time
    wanted = {
        "policy_hash": baseline_of(spec, HANDMADE).content_hash,
        "policy_id": HANDMADE,
        **dict.fromkeys(("perturbation", "training_discretization", "training_seed")),
        "plain": True,
        "trace_every": len(spec.start_sets) * spec.episodes,
        **({} if setup is None else {"float_width": setup["float_width"]}),
    }
    for place, starts in enumerate(spec.start_sets):
        numbers = {spec.attempt(place, k): spec.start_seed(starts, k) for k in spec.latest}
        tried = [rows.get(ATTEMPT, {}).get(number) for number in numbers]
        phases: list[Any] = [(ATTEMPT, "attempt", {})]
        if twice is not None and any(row and not row["success"] for row in tried):
            phases.append((LATER_ATTEMPT, "the second horizon of attempt", twice))
        for (phase, what, changed), (number, seed) in product(phases, numbers.items()):
            row = rows.get(phase, {}).get(number)
            if row is None:
                yield Finding(file, None, f"{what} {number} in cell {cell.name!r} is missing")
                continue
            yield from _of_row(row, {**wanted, "seed": seed, "rng_key": f"{seed}/0"})
            if setup is not None and not _has_setup(row, setup["arguments"], changed):
                yield Finding(file, row["record_id"], "its setup is not that of its cell")


def _of_row(row: Mapping[str, Any], wanted: Mapping[str, Any]) -> Iterator[Finding]:
    said = {name: row[name] for name in wanted}
    return deny("evidence", row["record_id"], "", said, wanted)


def _has_setup(
    row: Mapping[str, Any], own: str | None, changed: Mapping[str, float] | None
) -> bool:
    """Whether a record's arguments are those of its cell but for what is changed."""
    if own is None:
        return False
    return argument_values(row["arguments"]) == {**argument_values(own), **(changed or {})}
