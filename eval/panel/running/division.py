"""Which policies are trained together: divided once, and noted, so that all runs of a panel agree.

What a policy is trained beside shows in the last bits of its weights. So what goes on after a kill,
with another number of processes or on another engine, keeps to the division that was begun with.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from integ_gym.support.files import read_object, write_json
from integ_gym.train.fleet.worker import Workers

from ..plan import stages
from ..spec import PanelSpec
from .run_directory import WORK, RunDirectory
from .units import Unit, is_there, trained_units, training_config

_CHUNKS = "together"
_DIVISION = "division.json"


def waiting_chunks(
    spec: PanelSpec, directory: RunDirectory, workers: Workers, memory_gib: float | None = None
) -> list[tuple[Unit, ...]]:
    """The training runs that are not finished, each with all that it is trained together with.

    Args:
        spec: the panel, or a stage of it.
        directory: held by the caller.
        workers: that the work is divided for, if it was not before.
        memory_gib: that they may take together.
    """
    units = {unit.policy: unit for unit in trained_units(spec)}
    waiting = {unit.policy for unit in units.values() if not is_there(spec, directory, unit)}
    noted = _noted_chunks(directory)
    chunks = [tuple(map(str, chunk)) for chunk in noted if set(chunk) <= set(units)]
    known = {policy for chunk in chunks for policy in chunk}
    for stage in stages(spec):
        new = [u for u in trained_units(stage) if u.policy in waiting and u.policy not in known]
        chunks += _divided(spec, new, workers, memory_gib)
        known.update(unit.policy for unit in new)
    if len(chunks) > len(noted):
        write_json(directory.path / WORK / _DIVISION, {_CHUNKS: chunks})
        directory.storage.send()
    return [tuple(units[p] for p in chunk) for chunk in chunks if waiting.intersection(chunk)]


def _noted_chunks(directory: RunDirectory) -> list[Any]:
    """Who is trained together, as it was noted."""
    path = directory.path / WORK / _DIVISION
    return list(read_object(path, {_CHUNKS: list}, "remove it")[_CHUNKS]) if path.exists() else []


def _divided(
    spec: PanelSpec, units: Sequence[Unit], workers: Workers, memory_gib: float | None
) -> list[tuple[str, ...]]:
    if not units:
        return []
    if not spec.fleet:
        return [(unit.policy,) for unit in units]
    from integ_gym.train.fleet.planning import plan

    configs = [training_config(spec, unit) for unit in units]
    chunks = plan(configs, workers, memory_gib)  # type: ignore[arg-type]
    return [tuple(units[place].policy for place in chunk.places) for chunk in chunks]
