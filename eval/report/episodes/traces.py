"""Traces of chosen episodes, read from the evidence."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from integ_gym.evidence.store import EvidenceStore

from ...panel.model.panel import Panel
from .choice import Lead
from .outcomes import Array

MOST_SAMPLES: Final = 480
"""Of a trace; of a longer one every n-th is taken."""

_FIELDS: Final = (
    "record_id", "policy_id", "cell", "episode_index", "success", "failure_label",
    "failure_reason", "time_to_success", '"return"', "energy_start", "energy_end", "length",
    "work_total", "energy_residual_total", "dissipated_total", "contact_loss_total",
    "clip_loss_total", "control_period", "initial_state",
)  # fmt: skip
_SUMS: Final = ("work", "energy_residual", "dissipated", "contact_loss", "clip_loss")

Key = tuple[str, str, int, int]
"""Row, cell, place of the seed, and episode."""


@dataclass(frozen=True)
class Trace:
    """An episode to watch.

    Attributes:
        key: which one.
        fields: its record's fields by name.
        period: time between two samples, s.
        motion: coordinates by name, shape (samples,).
        control: in force from each sample on, by name, shape (samples,).
        ledger: work of the motor, of the numerics, and losses since the start, J, shape
            (3, samples).
    """

    key: Key
    fields: Mapping[str, Any]
    period: float
    motion: Mapping[str, Array]
    control: Mapping[str, Array]
    ledger: Array


def traces_of(panel: Panel, store: EvidenceStore, leads: Iterable[Lead]) -> list[Trace]:
    """The traces that the leads ask for, in their order; without those that were not kept."""
    keys: dict[Key, None] = {}
    for lead in leads:
        keys.update(dict.fromkeys((lead.row, c, lead.seed, lead.episode) for c in lead.cells))
    if not keys:
        return []
    policies = {(r, s): panel.row(r).policies[s].id for r, _, s, _ in keys}
    wanted = {(policies[r, s], c, e): (r, c, s, e) for r, c, s, e in keys}
    states, controls = _columns(store)
    columns = ", ".join(
        (*_FIELDS, *(_named(name) for name in ("time", *states, *controls, *_SUMS)))
    )
    where = " AND ".join(
        f"{name} IN ({', '.join(sorted({_literal(key[place]) for key in wanted}))})"
        for place, name in enumerate(("policy_id", "cell", "episode_index"))
    )
    table = store.query(f"SELECT {columns} FROM records WHERE phase = 'evaluation' AND {where}")
    found = {}
    for record in table.to_pylist():
        key = wanted.get((record["policy_id"], record["cell"], record["episode_index"]))
        if key is not None and record["time"] and record["length"]:
            found[key] = _trace(key, record, states, controls)
    return [found[key] for key in keys if key in found]


def _columns(store: EvidenceStore) -> tuple[list[str], list[str]]:
    """Names of the coordinates and of the applied controls, from the order of the columns."""
    names = [
        str(name) for name in store.query("DESCRIBE records").column("column_name").to_pylist()
    ]
    after = names[names.index("time") + 1 :]
    states = list(itertools.takewhile(lambda name: not name.startswith("sensed_"), after))
    coordinates = [name for name in states if not name.endswith("_dot")]
    return coordinates[:4], [name for name in after if name.endswith("_applied")][:2]


def _trace(key: Key, record: Mapping[str, Any], states: list[str], controls: list[str]) -> Trace:
    length = record["length"]
    sums = {name: _cumulative(record[name], length) for name in _SUMS}
    losses = sums["dissipated"] + sums["contact_loss"] + sums["clip_loss"]
    ledger = np.stack((sums["work"], sums["energy_residual"], losses))
    motion = {name: _numbers(record[name], length + 1) for name in states}
    control = {name: _held(record[name], length) for name in controls}
    every = -(-(length + 1) // MOST_SAMPLES)
    kept = np.arange(0, length + 1, every)
    return Trace(
        key,
        {name: record[name] for name in map(_bare, _FIELDS)},
        record["control_period"] * every,
        {name: values[kept] for name, values in motion.items()},
        {name: values[kept] for name, values in control.items()},
        ledger[:, kept],
    )


def _numbers(values: Any, count: int) -> Array:
    """Finite numbers, the last one known where there is none."""
    found = np.array([np.nan if x is None else x for x in (values or ())][:count], float)
    found = np.concatenate((found, np.full(count - len(found), np.nan)))
    known = np.where(np.isfinite(found), np.arange(count), 0)
    numbers: Array = np.nan_to_num(found[np.maximum.accumulate(known)], posinf=0.0, neginf=0.0)
    return numbers


def _held(values: Any, length: int) -> Array:
    numbers = _numbers(values, length)
    return np.append(numbers, numbers[-1:])


def _cumulative(values: Any, length: int) -> Array:
    steps = np.zeros(length) if values is None else np.nan_to_num(
        np.array([0.0 if x is None else x for x in values][:length], float),
        posinf=0.0, neginf=0.0,
    )  # fmt: skip
    return np.concatenate(([0.0], np.cumsum(steps)))


def _named(name: str) -> str:
    return '"' + name.replace('"', '""') + '"'


def _bare(name: str) -> str:
    return name.strip('"')


def _literal(value: Any) -> str:
    return str(value) if isinstance(value, int) else "'" + str(value).replace("'", "''") + "'"
