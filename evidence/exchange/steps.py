"""The trace of a record as episodes of other tools have it: observations, actions, and the rest."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from integ_gym.envs.registries import ENVIRONMENTS

from ..episodes.decisions import choices, told_setup
from ..episodes.record import EvidenceRecord

Array = npt.NDArray[Any]

NO_CHOICE = "in which the fallback acted, which is no action of the discrete set"

_CLOCKS = ("time", "sensor_time")


@dataclass(frozen=True)
class Columns:
    """Trace columns by what they are.

    Attributes:
        sensed: observations.
        states: true state.
        controls: commanded.
        instants: further values at control instants.
        steps: further values of control steps.
    """

    sensed: tuple[str, ...]
    states: tuple[str, ...]
    controls: tuple[str, ...]
    instants: tuple[str, ...]
    steps: tuple[str, ...]


def columns_of(told: Mapping[str, Mapping[str, str]]) -> Columns:
    """Trace columns by what they are, from what is said of each."""
    at = {name: about["at"] for name, about in told.items()}
    sensed = tuple(name for name in at if name.startswith("sensed_"))
    controls = tuple(name for name in at if name.endswith("_commanded"))
    instants = [n for n in at if at[n] == "instant" and n not in sensed]
    known = (*_CLOCKS, "energy")
    return Columns(
        sensed,
        tuple(name for name in instants if name not in known),
        controls,
        tuple(name for name in instants if name in known),
        tuple(n for n in at if at[n] == "step" and n not in controls),
    )


def column(record: EvidenceRecord, name: str, rows: int) -> Array:
    """A column as numbers of 64 bits; NaN where the record has none."""
    found = record.trace.get(name)
    return np.full(rows, np.nan) if found is None else found.astype(np.float64)


def is_discrete(env_id: str, arguments: str) -> bool:
    """Whether actions are choices; False for environments that are not ours."""
    return env_id in ENVIRONMENTS and told_setup(env_id, arguments).task.discrete is not None


def actions_of(record: EvidenceRecord, controls: tuple[str, ...]) -> Array | None:
    """What was decided: float64 of shape (length, controls), or int64 of shape (length,).

    None where the fallback acted in place of a choice.
    """
    asked = stacked_steps(record, controls)
    fields = record.fields
    if not is_discrete(fields["env_id"], fields["arguments"]):
        return asked
    chosen = choices(told_setup(fields["env_id"], fields["arguments"]).task, asked[:, 0])
    return None if np.isnan(chosen).any() else chosen.astype(np.int64)


def stacked_steps(record: EvidenceRecord, names: tuple[str, ...]) -> Array:
    """Columns of control steps side by side, float64 of shape (length, names)."""
    return _stacked(record, names, len(record.trace["reward"]))


def stacked_instants(record: EvidenceRecord, names: tuple[str, ...]) -> Array:
    """Columns of control instants side by side, float64 of shape (length + 1, names)."""
    return _stacked(record, names, len(record.trace["reward"]) + 1)


def _stacked(record: EvidenceRecord, names: tuple[str, ...], rows: int) -> Array:
    own = [column(record, name, rows) for name in names]
    return np.stack(own, axis=1) if own else np.empty((rows, 0))
