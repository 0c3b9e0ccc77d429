"""What a page carries for its script: entries of the matrix and single episodes, deflated.

The page's `unpack.js` is the other half. Numbers of 16 or 32 bits are stored as planes of bytes,
the lowest first, which deflate well; samples of a trace as differences from the one before.
"""

from __future__ import annotations

import base64
import json
import math
import re
import shlex
import zlib
from collections.abc import Callable, Sequence
from typing import Any, Final

import numpy as np
from gymnasium import spaces

from integ_gym.envs.ops.ops import Array, split_state
from integ_gym.evidence.labels import failure_sentence
from integ_gym.support.terminal import compact, fixed, nonbreaking, percent, step
from integ_gym.train.policy import MlpPolicy

from ..film import LEAST_START
from ..panel.result import Entry, Panel
from ..statistics import Estimate
from . import matrices
from .episodes import LEDGER, Episodes, Trace, choice_words
from .task import Task

UNKNOWN: Final = -32768
"""Stands for a ledger that is not known."""

MOST_LEDGERS: Final = 250_000
"""Episodes whose ledger a page carries; of more, only those of the declared family's cells."""

ROBOT_STEP: Final = 5e-4
"""Between two numbers of a robot's motion, m or rad: finer ones are not seen, and deflate badly."""

LABEL_WORDS: Final = {
    "evaluation_error": "simulator or metric broke",
    "contract_error": "differs from home before any integration",
    "unachievable": "a search over controls misses the goal's energy from most starts",
    "not_learned": "the policy fails at home, too",
    "too_slow": "succeeds from the same start in twice the time",
    "discretization_error": "succeeds from the same start at home",
    "perception_error": "succeeds without sensor noise",
    "state_error": "succeeds without delay or staleness",
    "control_error": "saturated, or left the goal after reaching it",
    "planning_error": "never reached the goal, unsaturated",
    "unattributed": "a needed replay was not run",
}
"""Failure labels in words, in the order in which their rules are tried."""

_MEASURES: Final = {
    "success": matrices.success_matrix,
    "loss": matrices.loss_matrix,
    "return": matrices.return_matrix,
    "command": matrices.command_matrix,
    "energy": matrices.energy_matrix,
    "time to success": matrices.time_matrix,
}
_LEVELS: Final = 65535
_PLAIN = re.compile(r"[\w@%+=:,./-]+", re.ASCII)


def pack_payload(
    panel: Panel, episodes: Episodes | None, task: Task | None, href: Callable[[str], str]
) -> str:
    """Length of a JSON text in four bytes, little-endian, the text, and numbers; as Base64.

    Args:
        panel: what the page is about.
        episodes: single ones; None where no evidence is beside the panel.
        task: what is asked; None where that is not known.
        href: from a file of the panel to a link.
    """
    rows, cells = panel.row_places, panel.cell_places
    files = {name for entry in panel.matrix for name in entry.file}
    head = {
        "directory": panel.directory,
        "scene": task.scene if task else None,
        "choice": choice_words(panel),
        "leastStart": LEAST_START,
        "labelWords": LABEL_WORDS,
        "files": {name: href(name) for name in sorted(files)},
        "cells": [{"name": c.name, "shown": panel.label(c.name)} for c in panel.cells],
        "rows": [
            {
                "shown": panel.label(row.name),
                "homes": [cells[name] for name in row.shares if name in cells],
                "policies": [
                    {
                        "id": policy.id,
                        "seed": policy.seed,
                        "hash": policy.hash and policy.hash[:16],
                        "file": policy.file and href(policy.file),
                    }
                    for policy in row.policies
                ],
            }
            for row in panel.rows
        ],
        "groups": [
            {
                "name": group.label,
                "truth": group.reference,
                "steps": [step(cell.dt) for cell in group.cells],
            }
            for group in panel.groups
        ],
        "entries": {f"{rows[e.row]}/{cells[e.cell]}": _entry(panel, e) for e in panel.matrix},
        "measures": _measures(panel),
    }
    numbers = bytearray()
    if episodes is not None:
        head |= _episodes(panel, episodes, numbers)
    text = json.dumps(head, ensure_ascii=False, separators=(",", ":"), allow_nan=False).encode()
    press = zlib.compressobj(9, zlib.DEFLATED, -zlib.MAX_WBITS)
    data = press.compress(len(text).to_bytes(4, "little") + text + numbers) + press.flush()
    return base64.b64encode(data).decode()


def quote_command(words: Sequence[str]) -> str:
    """A command line of these words, in double quotes where a word holds single ones."""

    def quote(word: str) -> str:
        if _PLAIN.fullmatch(word):
            return word
        double = "'" in word and not re.search(r'["$`\\!]', word)
        return f'"{word}"' if double else shlex.quote(word)

    return " ".join(map(quote, words))


def _measures(panel: Panel) -> list[dict[str, Any]]:
    """The matrices that a reader can choose from, each cell as its script shows it."""

    def shown(shade: matrices.Shade) -> list[str]:
        return [
            shade.text,
            matrices.shade_style(shade),
            " ".join(shade.marks),
            shade.words,
            shade.tone,
        ]

    return [
        {
            "name": name,
            "about": matrix.about,
            "ends": matrix.ends,
            "notes": matrix.notes,
            "signed": matrix.signed,
            "cells": {
                panel.anchor(line.row.name, cell): shown(shade)
                for block in matrix.blocks
                for line in block.lines
                for cell, shade in line.shades.items()
                if shade is not None
            },
        }
        for name, describe in _MEASURES.items()
        if (matrix := describe(panel)) is not None
    ]


def _entry(panel: Panel, entry: Entry) -> dict[str, Any]:
    """The numbers of one entry as (name, text) pairs, and where its records are."""

    def three(value: float | None) -> str:
        return compact(value, 3)

    def signed(value: float | None) -> str:
        return compact(value, 3, True)

    time = _interval(entry.time_to_success, three, " s")
    facts = {
        "success": _interval(entry.success),
        f"return, {matrices.mean_words(panel)}": _interval(entry.returns, three),
        "time to success": time
        and f"{time}, {entry.time_to_success_episodes} of {entry.episodes} episodes",
        "energy residual": _interval(entry.energy_residual, signed, " J"),
        "energy residual, size": _interval(entry.energy_residual_abs, three, " J"),
        "within two horizons": _interval(entry.recovered),
        "loss against home": _interval(entry.home_drop),
        "of it difficulty": _interval(entry.difficulty),
        "of it deadline": _interval(entry.deadline),
        "of it overfitting": _interval(entry.overfitting),
        "seeds that lose more than half": _interval(entry.tail),
        "worst seed": entry.worst_policy and f"{entry.worst_policy}, {fixed(entry.worst_loss)}",
        "energy from the numerics": _interval(entry.numerics_share, percent),
        "transfer gap": _interval(entry.transfer_gap),
        f"against the {panel.yardstick_name}": (entry.reference_class or "").replace("_", " "),
        "the cell": matrices.explain_solvability(panel, panel.cell(entry.cell)),
        "episodes": f"{entry.episodes:,}",
        "diverged": entry.diverged and str(entry.diverged),
        "solver not converged": entry.not_converged and str(entry.not_converged),
    }
    try:
        query = quote_command(shlex.split(entry.query))
    except ValueError:
        query = entry.query
    shown = [[name, nonbreaking(text)] for name, text in facts.items() if text]
    return {"facts": shown, "file": entry.file, "query": query}


def _interval(
    value: Estimate | None, show: Callable[[float | None], str] = fixed, unit: str = ""
) -> str | None:
    if value is None:
        return None
    ends = f" ({' to '.join(map(show, value.ends))})" if value.bounded else ""
    return f"{show(value.estimate)}{ends}{unit}"


def _episodes(panel: Panel, episodes: Episodes, numbers: bytearray) -> dict[str, Any]:
    rows, cells = panel.row_places, panel.cell_places
    outcomes, live = episodes.outcomes, episodes.live
    names = sorted({str(x) for own in outcomes.values() for x in np.unique(own.label)})
    unit = _ledger_unit(episodes)
    small = sum(own.label.size for own in outcomes.values()) <= MOST_LEDGERS
    family = {(judged.row, judged.cell) for judged in panel.verdicts}
    entries: dict[tuple[str, str], dict[str, Any]] = {}
    for pair, own in outcomes.items():
        labels = _add(numbers, np.searchsorted(names, own.label).astype(np.uint8))
        entries[pair] = {"n": own.label.shape[1], "label": labels}
    for pair, own in outcomes.items():
        if small or pair in family:
            known = np.isfinite(own.ledger)
            multiples = np.round(np.where(known, own.ledger, 0.0) / unit).clip(-32767, 32767)
            ledger = np.where(known, multiples, UNKNOWN).astype(np.int16)
            entries[pair]["ledger"] = [_add(numbers, values) for values in ledger]
    finest = 0.0 if episodes.skeleton is None else ROBOT_STEP
    traces = [
        {"at": [rows[row], cells[cell], seed, episode], **_trace(trace, numbers, finest)}
        for trace in episodes.traces
        for row, cell, seed, episode in [trace.key]
    ]
    return {
        "labels": names,
        "skeleton": episodes.skeleton,
        "unit": unit,
        "outcomes": {f"{rows[row]}/{cells[cell]}": own for (row, cell), own in entries.items()},
        "traces": traces,
        "leads": [
            {
                "at": [rows[lead.row], cells[lead.cell], lead.seed, lead.episode],
                "kind": lead.kind,
                "cells": [cells[name] for name in lead.cells],
            }
            for lead in episodes.leads
        ],
        "live": live
        and {
            "periods": {cells[name]: period for name, period in live.periods.items()},
            "coordinate": live.coordinate,
            "reach": round(live.reach, 4),
            "policies": [
                {"at": [rows[row], seed], **_network(policy, numbers)}
                for (row, seed), policy in live.policies.items()
            ],
        },
    }


def _ledger_unit(episodes: Episodes) -> float:
    """A power of ten, J, in which the ledgers have three digits or so."""
    sizes = [np.abs(own.ledger[np.isfinite(own.ledger)]) for own in episodes.outcomes.values()]
    joined = np.concatenate(sizes) if sizes else np.zeros(0)
    typical = float(np.quantile(joined, 0.98)) if joined.size else 0.0
    return 10.0 ** (math.floor(math.log10(typical)) - 2) if typical > 0.0 else 1.0


def _network(policy: MlpPolicy, numbers: bytearray) -> dict[str, Any]:
    """Weights, and how outputs become an action; `low` is missing where it is a choice."""
    layers = [
        [*weight.shape, _add(numbers, weight), _add(numbers, bias)]
        for weight, bias in policy.layers
    ]
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


def _trace(trace: Trace, numbers: bytearray, finest: float) -> dict[str, Any]:
    fields = trace.fields
    parts = ("contact_loss_total", "clip_loss_total", "dissipated_total")
    lost = None if fields["dissipated_total"] is None else sum(fields[p] or 0.0 for p in parts)
    totals = (fields["work_total"], fields["energy_residual_total"], lost)

    def column(values: Array) -> list[float]:
        """[least value, step, place] of samples that are stored as steps from the least."""
        low, high = float(values.min()), float(values.max())
        size = max((high - low) / _LEVELS, finest) or 1.0
        levels = np.round((values - low) / size).astype(np.int64)
        differences = np.diff(levels, prepend=0) & 0xFFFF
        return [low, size, _add(numbers, differences.astype(np.uint16))]

    return {
        "id": fields["record_id"],
        "period": trace.period,
        "seconds": fields["length"] * fields["control_period"],
        "n": trace.ledger.shape[1],
        "success": fields["success"],
        "label": fields["failure_label"],
        "reason": nonbreaking(failure_sentence(fields)),
        "ended": fields["terminated"],
        "diverged": fields["solver_status"] == "diverged",
        "command": trace.command,
        "error": fields["command_error"],
        "since": fields["time_to_success"],
        "return": _finite(fields["return"]),
        "state": split_state(fields["initial_state"] or ()),
        "start": _finite(fields["energy_start"]),
        "end": _finite(fields["energy_end"]),
        "totals": [_finite(total) for total in totals],
        "motion": {name: column(values) for name, values in trace.motion.items()},
        "control": {name: column(values) for name, values in trace.control.items()},
        "ledger": {name: column(values) for name, values in zip(LEDGER, trace.ledger, strict=True)},
    }


def _add(numbers: bytearray, values: Array) -> int:
    """Add numbers as planes of bytes; returns where they begin."""
    place, size = len(numbers), values.dtype.itemsize
    little = np.ascontiguousarray(values, values.dtype.newbyteorder("<"))
    numbers += little.view(np.uint8).reshape(-1, size).T.tobytes()
    return place


def _finite(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None
