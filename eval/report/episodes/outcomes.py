"""The outcome and the ledger of every evaluation episode, by entry of the matrix."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from integ_gym.evidence.store import EvidenceStore

from ...panel.model.matrix import Entry
from ...panel.model.panel import Panel

Array = npt.NDArray[Any]

LEDGER: Final = ("motor", "numerics", "losses")
"""What adds up to the change of energy, losses taken away."""

_SQL: Final = """
SELECT policy_id, cell, episode_index, failure_label AS label, work_total AS motor,
  energy_residual_total AS numerics,
  dissipated_total + coalesce(contact_loss_total, 0) + clip_loss_total AS losses,
  coalesce(time_to_success, 'nan'::DOUBLE) AS "time", episode_index % trace_every = 0 AS traced
FROM records WHERE phase = 'evaluation'
"""


@dataclass(frozen=True)
class Outcomes:
    """What became of the episodes of one entry.

    Attributes:
        label: failure labels, shape (seeds, episodes).
        ledger: J, NaN where it is not known, shape (3, seeds, episodes), as :data:`LEDGER`.
        time: time to success, s, NaN where there is none, shape (seeds, episodes).
        traced: whether a trace was kept, shape (seeds, episodes).
    """

    label: Array
    ledger: Array
    time: Array
    traced: Array


def outcomes_of(panel: Panel, store: EvidenceStore) -> dict[tuple[str, str], Outcomes]:
    """Outcomes by row and cell, of the entries whose episodes are all on record."""
    table = store.query(_SQL)
    columns = {name: table.column(name).to_numpy(zero_copy_only=False) for name in
               table.column_names}  # fmt: skip
    order = np.lexsort((columns["episode_index"], columns["policy_id"], columns["cell"]))
    columns = {name: values[order] for name, values in columns.items()}
    groups = _groups(columns["policy_id"], columns["cell"])
    found = {}
    for entry in panel.matrix:
        own = _stacked(panel, entry, groups, columns)
        if own is not None:
            found[entry.row, entry.cell] = own
    return found


def _groups(policies: Array, cells: Array) -> dict[tuple[str, str], slice]:
    """Where the episodes of each policy and cell stand, neighbours as they are."""
    found: dict[tuple[str, str], slice] = {}
    start = 0
    for (policy, cell), own in itertools.groupby(zip(policies, cells, strict=True)):
        end = start + sum(1 for _ in own)
        found[str(policy), str(cell)] = slice(start, end)
        start = end
    return found


def _stacked(
    panel: Panel,
    entry: Entry,
    groups: Mapping[tuple[str, str], slice],
    columns: Mapping[str, Array],
) -> Outcomes | None:
    policies = panel.row(entry.row).policies
    slices = [groups.get((policy.id, entry.cell)) for policy in policies]
    sizes = {0 if found is None else found.stop - found.start for found in slices}
    if not policies or len(sizes) != 1 or sizes == {0}:
        return None

    def stacked(name: str) -> Array:
        return np.stack([columns[name][found] for found in slices])

    ledger = np.stack([stacked(name).astype(np.float64) for name in LEDGER])
    return Outcomes(
        stacked("label").astype(str), ledger, stacked("time").astype(float),
        stacked("traced").astype(bool),
    )  # fmt: skip
