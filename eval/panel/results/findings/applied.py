"""What the environments of each cell really did."""

from __future__ import annotations

from integ_gym.evidence.store import EvidenceStore
from integ_gym.support.errors import InputError

from ...model.matrix import AppliedDiscretization
from ...model.part import build

COLUMNS = ("engine", "engine_version", "integrator", "dt", "substeps", "control_period")


def applied_in(store: EvidenceStore) -> dict[str, AppliedDiscretization]:
    """What was applied, by cell, from the records of evaluations.

    Raises:
        ValueError: if the records of a cell do not agree.
    """
    names = ", ".join(COLUMNS)
    rows = store.query(f"SELECT DISTINCT cell, {names} FROM records WHERE phase = 'evaluation'")
    found: dict[str, AppliedDiscretization] = {}
    for row in rows.to_pylist():
        cell = row.pop("cell")
        if cell in found:
            raise InputError(f"records of cell {cell!r} do not agree on {names}")
        found[cell] = build(AppliedDiscretization, **row)
    return found
