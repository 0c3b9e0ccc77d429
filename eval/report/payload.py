"""Episodes as a page carries them: JSON and numbers, deflated.

The page's `unpack.js` is the other half. Numbers of 16 or 32 bits are stored as planes of bytes,
the lowest first, which deflate well; samples of a trace as differences from the one before.
"""

from __future__ import annotations

import base64
import json
import math
import zlib
from collections.abc import Callable, Mapping
from typing import Any, Final

import numpy as np
from gymnasium import spaces

from integ_gym.evidence.labels import failure_sentence
from integ_gym.train.policy import MlpPolicy

from ..panel.result import Panel
from .episodes import LEDGER, Array, Live, Told, Trace

UNKNOWN: Final = -32768
"""Stands for a ledger that is not known."""

MOST_LEDGERS: Final = 250_000
"""Episodes whose ledger a page carries; of more, only those of the declared family's cells."""

_LEVELS: Final = 65535


class Blob:
    """JSON and numbers, put together."""

    def __init__(self) -> None:
        self._parts: list[bytes] = []
        self._size = 0

    def add(self, values: Array) -> int:
        """Add bytes, or wider numbers as planes of bytes; returns where they begin."""
        if values.dtype.itemsize == 1:
            data = values.astype(np.uint8).tobytes()
        else:
            size = values.dtype.itemsize
            little = np.ascontiguousarray(values, values.dtype.newbyteorder("<"))
            data = np.ascontiguousarray(little.view(np.uint8).reshape(-1, size).T).tobytes()
        place, self._size = self._size, self._size + len(data)
        self._parts.append(data)
        return place

    def packed(self, head: Mapping[str, Any]) -> str:
        """Length of the JSON in four bytes, little-endian, JSON, numbers; deflated, in Base64."""
        text = json.dumps(head, ensure_ascii=False, separators=(",", ":"), allow_nan=False).encode()
        content = len(text).to_bytes(4, "little") + text + b"".join(self._parts)
        return base64.b64encode(_deflated(content)).decode()


def packed(
    panel: Panel, told: Told | None, head: Mapping[str, Any], said: Callable[[str], str]
) -> str:
    """The text that a page carries: what it says of entries, and all that is told of episodes.

    ``said`` puts a sentence as the page puts it.
    """
    blob = Blob()
    more = {} if told is None else _told(panel, told, blob, said)
    return blob.packed({**head, **more})


def _told(panel: Panel, told: Told, blob: Blob, said: Callable[[str], str]) -> dict[str, Any]:
    rows = {row.name: place for place, row in enumerate(panel.rows)}
    cells = {cell.name: place for place, cell in enumerate(panel.cells)}
    names = sorted({str(x) for own in told.outcomes.values() for x in np.unique(own.label)})
    unit = _unit(told)
    total = sum(own.label.size for own in told.outcomes.values())
    family = {(judged.row, judged.cell) for judged in panel.verdicts}
    entries = {}
    for (row, cell), own in told.outcomes.items():
        labels = blob.add(np.searchsorted(names, own.label).astype(np.uint8))
        entries[f"{rows[row]}/{cells[cell]}"] = {"n": own.label.shape[1], "label": labels}
    for (row, cell), own in told.outcomes.items():
        if total <= MOST_LEDGERS or (row, cell) in family:
            places = [blob.add(_rounded(values, unit)) for values in own.ledger]
            entries[f"{rows[row]}/{cells[cell]}"]["ledger"] = places
    return {
        "labels": names,
        "unit": unit,
        "outcomes": entries,
        "traces": [_trace(trace, rows, cells, blob, said) for trace in told.traces],
        "leads": [
            {
                "at": [rows[lead.row], cells[lead.cell], lead.seed, lead.episode],
                "kind": lead.kind,
                "cells": [cells[name] for name in lead.cells],
            }
            for lead in told.leads
        ],
        "live": None if told.live is None else _live(told.live, rows, cells, blob),
    }


def _live(
    live: Live, rows: Mapping[str, int], cells: Mapping[str, int], blob: Blob
) -> dict[str, Any]:
    return {
        "periods": {cells[name]: period for name, period in live.periods.items()},
        "coordinate": live.coordinate,
        "reach": round(live.reach, 4),
        "policies": [
            {"at": [rows[row], seed], **_network(policy, blob)}
            for (row, seed), policy in live.policies.items()
        ],
    }


def _network(policy: MlpPolicy, blob: Blob) -> dict[str, Any]:
    """Weights, and how outputs become an action; `low` is missing where it is a choice."""
    layers = [[*weight.shape, blob.add(weight), blob.add(bias)] for weight, bias in policy.layers]
    actions, scaling = policy.actions, policy.statistics
    bounds = {} if isinstance(actions.space, spaces.Discrete) else {
        "low": actions.space.low.tolist(), "high": actions.space.high.tolist(),
        "squash": actions.squash, "limit": _finite(actions.limit),
    }  # fmt: skip
    statistics = scaling and {
        "mean": scaling.mean.tolist(), "var": scaling.var.tolist(), "epsilon": scaling.epsilon,
        "clip": scaling.clip_obs,
    }  # fmt: skip
    return {"layers": layers, "activation": policy.activation, "statistics": statistics, **bounds}


def _unit(told: Told) -> float:
    """A power of ten, J, in which the ledgers have three digits or so."""
    sizes = [np.abs(own.ledger[np.isfinite(own.ledger)]) for own in told.outcomes.values()]
    joined = np.concatenate(sizes) if sizes else np.zeros(1)
    typical = float(np.quantile(joined, 0.98)) if joined.size else 0.0
    return 10.0 ** (math.floor(math.log10(typical)) - 2) if typical > 0.0 else 1.0


def _rounded(values: Array, unit: float) -> Array:
    """Multiples of the unit, 16 bits each."""
    known = np.isfinite(values)
    multiples = np.clip(np.round(np.where(known, values, 0.0) / unit), -32767, 32767)
    return np.where(known, multiples, UNKNOWN).astype(np.int16)


def _trace(
    trace: Trace,
    rows: Mapping[str, int],
    cells: Mapping[str, int],
    blob: Blob,
    said: Callable[[str], str],
) -> dict[str, Any]:
    row, cell, seed, episode = trace.key
    fields = trace.fields
    parts = ("contact_loss_total", "clip_loss_total", "dissipated_total")
    totals = (
        fields["work_total"],
        fields["energy_residual_total"],
        None if fields["dissipated_total"] is None else sum(fields[name] or 0.0 for name in parts),
    )
    return {
        "at": [rows[row], cells[cell], seed, episode],
        "id": fields["record_id"],
        "period": trace.period,
        "seconds": fields["length"] * fields["control_period"],
        "n": trace.ledger.shape[1],
        "success": fields["success"],
        "label": fields["failure_label"],
        "reason": said(failure_sentence(fields)),
        "since": fields["time_to_success"],
        "return": _finite(fields["return"]),
        "state": fields["initial_state"],
        "start": _finite(fields["energy_start"]),
        "end": _finite(fields["energy_end"]),
        "totals": [_finite(total) for total in totals],
        "motion": {name: _column(values, blob) for name, values in trace.motion.items()},
        "control": {name: _column(values, blob) for name, values in trace.control.items()},
        "ledger": {
            name: _column(values, blob) for name, values in zip(LEDGER, trace.ledger, strict=True)
        },
    }


def _column(values: Array, blob: Blob) -> list[float]:
    """[least value, step, place] of samples that are stored as steps from the least."""
    low, high = float(values.min()), float(values.max())
    step = (high - low) / _LEVELS or 1.0
    levels = np.round((values - low) / step).astype(np.int64)
    differences = np.diff(levels, prepend=0) & 0xFFFF
    return [low, step, blob.add(differences.astype(np.uint16))]


def _finite(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None


def _deflated(data: bytes) -> bytes:
    press = zlib.compressobj(9, zlib.DEFLATED, -zlib.MAX_WBITS)
    return press.compress(data) + press.flush()
