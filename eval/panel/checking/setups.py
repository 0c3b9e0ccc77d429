"""Where policies were evaluated and from which starts, held against the plan."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

from integ_gym.envs import DISCRETIZATION, NATIVE, is_integ_environment
from integ_gym.evidence import (
    EvidenceError,
    EvidenceStore,
    Finding,
    argument_values,
    told_perturbation,
    told_training,
)

from ..running import trained_units
from ..specification import (
    Cell,
    Home,
    PanelSpec,
    changes_of,
    environments_of,
    planned_home,
)

_SETUPS = """
SELECT policy_id, cell, env_id, engine, integrator, dt, control_period, perturbation, arguments,
       training_discretization, training_seed, trace_every, float_width,
       seed - episode_index AS first_seed, rng_key = seed || '/0' AS first_of_seed,
       (reward IS NULL) = (episode_index % trace_every = 0) AS traceless, count(*) AS records
FROM records WHERE phase = 'evaluation' GROUP BY ALL ORDER BY policy_id, cell
"""

_TRAINING = """
SELECT policy_id, count(*) AS records FROM records
WHERE phase = 'training' AND (reward IS NULL) = (episode_index % trace_every = 0)
GROUP BY ALL ORDER BY policy_id
"""

_TOLD = {"perturbation": told_perturbation, "training_discretization": told_training}


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
    for row in store.query(_TRAINING).to_pylist():
        message = f"{row['records']} training records of policy {row['policy_id']!r} have no trace"
        yield Finding("evidence", None, f"{message} where `trace_every` says that they have one")
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
        for name, wanted in expected.items():
            try:
                recorded = _read(name, row)
            except EvidenceError as error:
                yield Finding("evidence", None, f"{where}: {error}")
                continue
            if not _same(recorded, wanted):
                message = f"`{name}` is recorded as {recorded!r}, and planned as {wanted!r}"
                yield Finding("evidence", None, f"{where}: {message}")


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
    read = _TOLD.get(name)
    return row[name] if read is None else read(row)


def _same(recorded: Any, wanted: Any) -> bool:
    if isinstance(recorded, dict) and isinstance(wanted, dict):
        return recorded.keys() == wanted.keys() and all(
            _same(recorded[key], wanted[key]) for key in wanted
        )
    if isinstance(recorded, list) and isinstance(wanted, list | tuple):
        return len(recorded) == len(wanted) and all(map(_same, recorded, wanted))
    if isinstance(recorded, float) and isinstance(wanted, int | float):
        return math.isclose(recorded, wanted, rel_tol=1e-12)
    return bool(recorded == wanted)
