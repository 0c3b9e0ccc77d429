"""Where policies were evaluated and from which starts, held against the plan."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import gymnasium as gym

from integ_gym.envs.catalogue.lookup import is_integ_environment
from integ_gym.envs.settings import DISCRETIZATION, NATIVE
from integ_gym.evidence.schema import EvidenceError, Finding, argument_values, parse_field
from integ_gym.evidence.store import EvidenceStore
from integ_gym.train.policy_files.card import mixture_of

from ..cells import (
    Cell,
    Home,
    changes_of,
    environments_of,
)
from ..plan import planned_home
from ..running.run_directory import PACKAGES
from ..running.units import Unit, trained_units, training_config
from ..spec import PanelSpec

_SETUPS = """
SELECT policy_id, cell, env_id, engine, integrator, dt, control_period, perturbation, arguments,
       training_discretization, training_seed, trace_every, float_width,
       seed - episode_index AS first_seed, rng_key = seed || '/0' AS first_of_seed,
       (reward IS NULL) = (episode_index % trace_every = 0) AS traceless, count(*) AS records
FROM records WHERE phase = 'evaluation' GROUP BY ALL ORDER BY policy_id, cell
"""

_TRAINING = """
SELECT policy_id, cell, env_id, arguments, training_discretization, training_seed, trace_every,
       float_width, seed IS NULL AS unseeded,
       (reward IS NULL) = (episode_index % trace_every = 0) AS traceless, count(*) AS records
FROM records WHERE phase = 'training' GROUP BY ALL ORDER BY policy_id
"""

_LANES = """
SELECT policy_id, seed, rng_key, episode_index FROM records
WHERE phase = 'training' ORDER BY policy_id, episode_index
"""

BASE = ("python", *(name for name in PACKAGES if name != "scipy"))
"""Packages whose versions every record and every side-car has."""

_VERSIONS = """
SELECT package_versions, count(*) AS records FROM records GROUP BY ALL ORDER BY 1
"""

_PARSED = ("perturbation", "training_discretization")


class PlannedPolicy(NamedTuple):
    """A policy of a plan.

    Attributes:
        home: what it was trained on; None: nothing, or unknown.
        seed: of its training, or None.
        starts: training seed whose starts it acts from.
    """

    home: Home | None
    seed: int | None
    starts: int


def planned_policies(plan: Mapping[str, Any], spec: PanelSpec) -> dict[str, PlannedPolicy]:
    """The policies that a plan says will be evaluated, by id.

    Raises:
        SpecError: for an evaluation that does not say its policy's home.
    """
    found = {name: PlannedPolicy(None, None, spec.start_sets[0]) for name in spec.baselines}
    if "policy" in plan:
        name = spec.name.removeprefix("evaluate ")
        return {name: PlannedPolicy(planned_home(plan), None, 0), **found}
    units = trained_units(spec)
    trained = {unit.policy: PlannedPolicy(unit.home, unit.seed, unit.seed or 0) for unit in units}
    return {**found, **trained}


def of_setups(
    spec: PanelSpec, policies: Mapping[str, PlannedPolicy], store: EvidenceStore, own_code: bool
) -> Iterator[Finding]:
    """Records of other setups or starts than were planned, or without the trace that they have.

    Args:
        spec: of the run.
        policies: of its plan, by id.
        store: its records.
        own_code: whether setups may be made, which loads code that the plan names.
    """
    rows = [row for row in store.query(_SETUPS).to_pylist() if row["policy_id"] in policies]
    cells = _cells(spec, policies) if own_code else {}
    made: dict[str, dict[str, Any] | None] = {}
    for row in rows:
        where = f"{row['records']} records of policy {row['policy_id']!r} in cell {row['cell']!r}"
        expected: dict[str, Any] = {"trace_every": spec.trace_every, "traceless": False}
        cell = cells.get(row["cell"])
        if cell is not None:
            expected |= _planned(spec, policies[row["policy_id"]], cell)
        if cell is not None and row["engine"] == NATIVE and is_integ_environment(spec.env_id):
            if cell.name not in made:
                made[cell.name] = _arguments(spec, cell)
            expected |= {"arguments": made[cell.name], "float_width": 64, "first_of_seed": True}
        yield from _held(row, expected, where)


def of_training(
    spec: PanelSpec, units: Mapping[str, Unit], store: EvidenceStore, own_code: bool
) -> Iterator[Finding]:
    """Training records of other setups or starts than were planned, or without their trace.

    Args:
        spec: of the run.
        units: of its plan, by the policy that they train.
        store: its records.
        own_code: whether setups may be made, which loads code that the plan names.
    """
    made: dict[str, list[dict[str, Any]]] = {}
    for row in store.query(_TRAINING).to_pylist():
        policy = row["policy_id"]
        where = f"{row['records']} training records of policy {policy!r}"
        unit = units.get(policy)
        if unit is None or unit.home is None:
            yield Finding("evidence", None, f"{where}, which the plan does not train")
            continue
        config: Any = training_config(spec, unit)
        expected = {
            "cell": unit.training,
            "env_id": spec.env_id,
            "training_discretization": unit.home.arguments(),
            "training_seed": unit.seed,
            "trace_every": config.trace_every,
            "traceless": False,
            "unseeded": spec.fleet,
        }
        native = {home.engine for home in unit.home.shares} == {NATIVE}
        if own_code and native and is_integ_environment(spec.env_id):
            if policy not in made:
                made[policy] = _members(config)
            told = _told_or_none(row)
            near = [x for x in made[policy] if _same(told, x)]
            expected |= {"arguments": near[0] if near else made[policy][0]}
            expected["float_width"] = 32 if spec.fleet else 64
        yield from _held(row, expected, where)
    yield from _of_lanes(spec, units, store)


def _members(config: Any) -> list[dict[str, Any]]:
    """Constructor arguments of what a run trains on, as records have them."""
    env = gym.make_vec(
        config.env_id, 1, vectorization_mode="vector_entry_point", **config.env_arguments
    )
    env.close()
    return [json.loads(json.dumps(setup.arguments())) for setup in mixture_of(env).setups]


def _told_or_none(row: Mapping[str, Any]) -> Any:
    try:
        return argument_values(row["arguments"])
    except EvidenceError:
        return None


def _of_lanes(
    spec: PanelSpec, units: Mapping[str, Unit], store: EvidenceStore
) -> Iterator[Finding]:
    """Training episodes of generators that no environment of the run has, or twice of one."""
    seen: dict[str, set[str]] = {}
    for row in store.query(_LANES).to_pylist():
        unit = units.get(row["policy_id"])
        if unit is None or unit.home is None:
            continue
        config: Any = training_config(spec, unit)
        lanes = range(config.n_envs)
        if spec.fleet:
            known = {f"fleet-{unit.seed}-{lane}" for lane in lanes}
            seeded = row["seed"] is None
        else:
            known = {str(config.first_lane_seed + lane) for lane in lanes}
            seeded = f"{row['seed']}" == str(row["rng_key"]).partition("/")[0]
        name, _, number = str(row["rng_key"]).partition("/")
        own = seen.setdefault(row["policy_id"], set())
        fresh = number.isdecimal() and row["rng_key"] not in own
        own.add(row["rng_key"])
        if not (name in known and seeded and fresh):
            whose = f"training episode {row['episode_index']} of policy {row['policy_id']!r}"
            yield Finding("evidence", None, f"{whose} has no generator of its run's environments")


def of_versions(versions: Mapping[str, str], store: EvidenceStore) -> Iterator[Finding]:
    """Records of other versions than those that the run's manifest has."""
    for row in store.query(_VERSIONS).to_pylist():
        try:
            told = parse_field("package_versions", row["package_versions"])
        except EvidenceError as error:
            yield Finding("evidence", None, f"{row['records']} records: {error}")
            continue
        expected = {name: versions.get(name) for name in (*told, *BASE)}
        yield from _held({**row, "package_versions": told}, {"package_versions": expected}, None)


def _held(
    row: Mapping[str, Any], expected: Mapping[str, Any], where: str | None
) -> Iterator[Finding]:
    """What records alike say, and the plan does not."""
    told = f"{row['records']} records" if where is None else where
    for name, wanted in expected.items():
        try:
            recorded = _read(name, row)
        except EvidenceError as error:
            yield Finding("evidence", None, f"{told}: {error}")
            continue
        for place, one, other in differing(name, recorded, wanted):
            message = f"`{place}` is recorded as {one!r}, and planned as {other!r}"
            yield Finding("evidence", None, f"{told}: {message}")


def _cells(spec: PanelSpec, policies: Mapping[str, PlannedPolicy]) -> dict[str, Cell]:
    homes = dict.fromkeys(policy.home for policy in policies.values())
    return {cell.name: cell for home in homes for cell in spec.cells_of(home)}


def _planned(spec: PanelSpec, policy: PlannedPolicy, cell: Cell) -> dict[str, Any]:
    given = cell.arguments(spec.environment)
    return {
        "env_id": spec.env_id,
        **{name: given[name] for name in DISCRETIZATION},
        "perturbation": dict(changes_of(cell)) or None,
        "training_discretization": policy.home.arguments() if policy.home else None,
        "training_seed": policy.seed,
        "first_seed": spec.start_seed(policy.starts, 0),
    }


def _arguments(spec: PanelSpec, cell: Cell) -> dict[str, Any]:
    """Constructor arguments of a cell's environments, as records have them."""
    environments = environments_of(spec.testbed, cell, 1)
    environments.close()
    told: dict[str, Any] = json.loads(json.dumps(environments.setups[0].arguments()))
    return told


def _read(name: str, row: Mapping[str, Any]) -> Any:
    """A column's value, of text that holds JSON what it says.

    Raises:
        EvidenceError: for text that is not of its form.
    """
    if name == "arguments":
        return argument_values(row[name])
    return parse_field(name, row[name]) if name in _PARSED else row[name]


def _same(recorded: Any, wanted: Any) -> bool:
    return next(differing("", recorded, wanted), None) is None


def differing(
    place: str, recorded: Any, wanted: Any, tolerance: float = 1e-12
) -> Iterator[tuple[str, Any, Any]]:
    """Places at which plain data differ, with what is there and what is wanted there.

    Args:
        place: of both, keys joined by dots.
        recorded: as it was read.
        wanted: the same, computed.
        tolerance: of numbers, relative.
    """
    if isinstance(recorded, Mapping) and isinstance(wanted, Mapping):
        for key in {**recorded, **wanted}:
            if key in recorded and key in wanted:
                name = f"{place}.{key}".removeprefix(".")
                yield from differing(name, recorded[key], wanted[key], tolerance)
            else:
                yield f"{place}.{key}".removeprefix("."), recorded.get(key), wanted.get(key)
    elif isinstance(recorded, list) and isinstance(wanted, list | tuple):
        if len(recorded) != len(wanted):
            yield f"len({place})", len(recorded), len(wanted)
            return
        for number, (one, other) in enumerate(zip(recorded, wanted, strict=True)):
            yield from differing(f"{place}[{number}]", one, other, tolerance)
    elif not _equal(recorded, wanted, tolerance):
        yield place, recorded, wanted


def _equal(recorded: Any, wanted: Any, tolerance: float) -> bool:
    if isinstance(recorded, bool) or isinstance(wanted, bool):
        return recorded is wanted
    if isinstance(recorded, float) and isinstance(wanted, int | float):
        return math.isclose(recorded, wanted, rel_tol=tolerance)
    return bool(recorded == wanted)
